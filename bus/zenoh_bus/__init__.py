"""The bus over Zenoh: the only package that imports zenoh. Settings and their reasons: docs/adr/0001-zenoh.md."""

from bus.zenoh_bus.client import LastValue, ZenohBus
from bus.zenoh_bus.hub import HubBus
from bus.zenoh_bus.session import LEASE_MS, MAX_MESSAGE_BYTES, HubUnreachableError

__all__ = ["LEASE_MS", "MAX_MESSAGE_BYTES", "HubBus", "HubUnreachableError", "LastValue", "ZenohBus"]
