"""The unit of a field is the last part of its name: one table, used by schemas, pages and tests."""

SUFFIXES: dict[str, str] = {
    "px2": "px^2",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "px_per_m": "px/m",
    "mb_s": "MB/s",
    "bytes_s": "B/s",
    "m2": "m^2",
    "m": "m",
    "rad": "rad",
    "deg": "deg",
    "n": "N",
    "nm": "Nm",
    "px": "px",
    "s": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
    "hz": "Hz",
    "v": "V",
    "bytes": "B",
    "mb": "MB",
}
"""Suffix of a field name -> unit as printed. Longer suffixes win."""

_BY_LENGTH = sorted(SUFFIXES, key=len, reverse=True)


def unit_of(field: str) -> str:
    """Return the unit that a field's name states, or an empty string for a number without a unit."""
    for suffix in _BY_LENGTH:
        if field.endswith("_" + suffix):
            return SUFFIXES[suffix]
    return ""
