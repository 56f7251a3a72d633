"""What all tests share."""

import signal

from hypothesis import settings

# A busy machine is no defect: an example may take as long as it takes, the whole test has its timeout.
settings.register_profile("starboard", deadline=None)
settings.load_profile("starboard")

# Started in the background by a shell, a process inherits "ignore SIGINT", and so would every program under test.
signal.signal(signal.SIGINT, signal.default_int_handler)
