"""How commands fail: one line on stderr that says what to do, and exit code 2."""


class CliError(Exception):
    """A mistake of use; `starboard` prints its one line and exits with 2."""
