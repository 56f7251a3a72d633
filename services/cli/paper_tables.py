"""`starboard identify --paper-tables`: the papers' tables computed again, ours beside theirs."""

from __future__ import annotations

import json


def show(as_json: bool) -> None:
    """Print every table that can be computed, row by row, or all of them as one JSON document."""
    from marine.identification.paper_check import NOT_COMPUTABLE, tables

    found = tables()
    if as_json:
        done = [
            {
                "table": t.name,
                "title": t.title,
                "rows": len(t.rows),
                "max_relative_error": t.max_relative_error,
                "columns": t.columns,
                "values": [{"label": r.label, "ours": r.ours, "theirs": r.theirs} for r in t.rows],
            }
            for t in found
        ]
        print(json.dumps({"tables": done, "not_computable": NOT_COMPUTABLE}))
        return
    for t in found:
        print(f"\n{t.name}: {t.title}; largest difference {100.0 * t.max_relative_error:.2f} %")
        print(f"  {'':<22}" + "".join(f"{c:>22}" for c in t.columns))
        for row in t.rows:
            pairs = "".join(f"{f'{o:.4g} ({p:g})':>22}" for o, p in zip(row.ours, row.theirs, strict=True))
            print(f"  {row.label:<22}{pairs}")
    print("\nours (printed). Not computable:")
    for name, why in NOT_COMPUTABLE.items():
        print(f"  {name}: {why}")
