"""`starboard autotune`, apart from the running system: what is proposed, refused and printed."""

from __future__ import annotations

import pytest

from bus.messages import AxisModel, ControlGains, ExperimentPlan, ExperimentResult, Shaping, Tuning
from bus.messages import IdentifiedModel as Model
from bus.messages import IdentifiedParameter as Parameter
from services.cli.autotune import compared, lines, model_of, proposed
from services.tuning import complete
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
FILE = complete(Tuning(law="ipd"), PLADYPOS)
PRESENT = ControlGains(tuning=FILE, engaged=False, since_ns=1, configured=FILE, shaping=Shaping(share=0.7))
HEAVY = AxisModel(alpha=2.0 * PLADYPOS.model.yaw.alpha, beta_quadratic=0.5 * PLADYPOS.model.yaw.beta_quadratic)


def test_the_frequency_goes_to_the_axes_that_were_identified() -> None:
    yaw = proposed(PRESENT, None, 0.8, {"yaw": HEAVY})
    assert (yaw.parameters["w0_rad_s"], yaw.parameters["yaw_w0_rad_s"]) == (None, 0.8)
    assert yaw.models == FILE.models | {"yaw": HEAVY}
    surge = proposed(PRESENT, None, 0.8, {"surge": FILE.models["surge"]})
    assert (surge.parameters["w0_rad_s"], surge.parameters["yaw_w0_rad_s"]) == (0.8, None)
    assert proposed(PRESENT, "lqr", None, {"yaw": HEAVY}).parameters == {}


def test_the_present_gains_are_shown_on_the_identified_model() -> None:
    refused, document = compared(PLADYPOS, proposed(PRESENT, None, None, {"yaw": HEAVY}), PRESENT)
    assert not refused
    yaw, surge = document["yaw"], document["surge"]
    assert yaw["proposed"]["gains"]["k_p"] == pytest.approx(2.0 * yaw["present"]["gains"]["k_p"])
    assert yaw["present"]["step"]["overshoot_percent"] > 15.0
    assert yaw["proposed"]["step"]["overshoot_percent"] < 5.0
    assert surge["proposed"] == surge["present"]
    text = "\n".join(lines(document, ["yaw"]))
    assert "inertia alpha                                1.052            0.5261  Nm s2/rad" in text


def test_what_is_not_allowed_has_a_reason_and_the_present_gains_beside_it() -> None:
    refused, document = compared(PLADYPOS, proposed(PRESENT, None, 20.0, {"yaw": HEAVY}), PRESENT)
    assert "delay margin is 0.023 s" in refused
    assert document["yaw"].keys() == {"present"}


def test_the_best_methods_model_is_taken() -> None:
    best = Model(
        method="projection", parameters=(Parameter(name="alpha", value=1.5, unit="kg m^2"),
                                         Parameter(name="delta", value=0.1, unit="Nm")),
    )  # fmt: skip
    result = ExperimentResult(
        run="1", plan=ExperimentPlan(name="self-oscillation", axis="yaw"), began_ns=0, ended_ns=1, force=1.0,
        methods=(best, Model(method="other", failure="too short")),
    )  # fmt: skip
    assert model_of(result) == AxisModel(alpha=1.5)
