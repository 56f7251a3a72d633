"""The laws there are: every concrete `ControlLaw` in a file of this folder. Nothing else lists them."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import fields
from functools import cache
from typing import Any

import marine.control
from marine.control.base import ControlLaw


@cache
def known_laws() -> dict[str, type[ControlLaw]]:
    """Return all laws by name; raise ValueError when two files claim the same name."""
    for module in pkgutil.iter_modules(marine.control.__path__):
        importlib.import_module(f"{marine.control.__name__}.{module.name}")
    laws: dict[str, type[ControlLaw]] = {}
    for law in _concrete(ControlLaw):
        if law.__module__.startswith(marine.control.__name__ + "."):
            if law.name in laws:
                raise ValueError(f"two laws are called {law.name!r}: {laws[law.name].__module__}, {law.__module__}")
            laws[law.name] = law
    return dict(sorted(laws.items()))


def _concrete(kind: Any) -> list[type[ControlLaw]]:
    found: list[type[ControlLaw]] = [] if getattr(kind, "__abstractmethods__", None) else [kind]
    return found + [law for below in kind.__subclasses__() for law in _concrete(below)]


def laws_document() -> list[dict[str, object]]:
    """Return every law with its parameters, as JSON takes it: for the page's menu, `starboard tune --list`, docs."""
    return [
        {
            "name": law.name,
            "serves": law.serves,
            "integral": law.integral,
            "doc": (law.__doc__ or "").splitlines()[0],
            "parameters": [
                {"name": f.name, "default": f.default, "doc": f.metadata.get("doc", "")} for f in fields(law.Parameters)
            ],
        }
        for law in known_laws().values()
    ]
