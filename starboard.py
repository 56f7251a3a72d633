"""The public face of Starboard, for notebooks and third parties.

>>> from starboard import Recording, topics
>>> recording = Recording("recordings/20261122-101500_pladypos.mcap")
>>> recording.series(topics.SIMULATION_TRUTH, "x_m", "y_m")
"""

from bus import topics
from bus.config import Section
from bus.memory_bus import MemoryBus
from bus.service import Input, Output, Service
from logs.reader import Recording

__all__ = ["Input", "MemoryBus", "Output", "Recording", "Section", "Service", "topics"]
