"""A star on a Zenoh router that is none of ours, as on zenohd: our hub is its client and only keeps values."""

from __future__ import annotations

import json

import pytest

from benchmarks.bus import Crew, plain_router
from benchmarks.running_star import RunningStar, wait_for
from bus.hub import HubConfig
from bus.messages import HubStatistics
from bus.topics import HELM_STATE, HUB_STATISTICS, SIMULATION_TRUTH


def test_a_vessel_holds_over_a_plain_router_and_late_joiners_get_last_values() -> None:
    with Crew() as crew, plain_router(crew) as router, RunningStar(router=router) as star:
        star.hold(2.6, 1.9, 0.1, timeout_s=60.0)
        star.wait(
            SIMULATION_TRUTH,
            lambda t: abs(t.x_m - 2.6) < 0.01 and abs(t.y_m - 1.9) < 0.01 and abs(t.psi_rad - 0.1) < 0.02,
            30.0,
            "the vessel holds",
        )
        (known,) = star.bus.last_values(HELM_STATE.key)
        assert known.payload is not None
        assert HELM_STATE.message.decode(known.payload).mode == "hold"
        assert known.source == "helm"

        def told() -> HubStatistics | None:
            now = star.last(HUB_STATISTICS)
            return now if now and "camera/pose" in now.by_key else None

        assert wait_for(told, 5.0, "statistics").messages_hz > 50.0
        assert "hub_standby" not in star.states()
        shown = json.loads(star.cli("get", "helm/state", "--json").stdout)
        assert shown["value"]["mode"] == "hold"


def test_no_standby_beside_a_router() -> None:
    assert HubConfig(router="tcp/127.0.0.1:7447").addresses == ("tcp/127.0.0.1:7447",)
    with pytest.raises(ValueError, match="standby: with `router` there is none"):
        HubConfig(router="tcp/127.0.0.1:7447", standby="tcp/127.0.0.1:7448")
