"""What all tests share."""

import os
import signal

from hypothesis import settings

# Before numpy is loaded: the matrices here are small, and threads of two test processes that wait for each other
# took a hundred times the time of one.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A busy machine is no defect: an example may take as long as it takes, the whole test has its timeout.
settings.register_profile("starboard", deadline=None)
# In CI the examples are always the same: a rare one is found by a developer, not by somebody else's submission.
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "starboard")

# Started in the background by a shell, a process inherits "ignore SIGINT", and so would every program under test.
signal.signal(signal.SIGINT, signal.default_int_handler)
