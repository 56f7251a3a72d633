"""What all tests share."""

from hypothesis import settings

# A busy machine is no defect: an example may take as long as it takes, the whole test has its timeout.
settings.register_profile("starboard", deadline=None)
settings.load_profile("starboard")
