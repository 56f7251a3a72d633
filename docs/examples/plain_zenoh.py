"""A client of Starboard's bus in plain eclipse-zenoh, without our package: docs/wire-format.md in code.

python docs/examples/plain_zenoh.py tcp/127.0.0.1:7447 pladypos

It reads the last value of the state, listens to ten new ones, publishes a variable of its own with a heartbeat, looks
at one picture, and asks the helm to hold where the vessel is.
"""

import json
import os
import queue
import sys
import time

import zenoh

NAME = "guest"


def connect(endpoint: str) -> zenoh.Session:
    """Return a client of the hub. It connects again by itself when the hub was away."""
    settings = {
        "mode": "client",
        "connect": {
            "endpoints": endpoint.split(","),
            "timeout_ms": 5000,
            "exit_on_failure": True,
            "retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2},
        },
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tx": {"lease": 400}}, "unicast": {"open_timeout": 200}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


class Variable:
    """Publishes one key: every message has the header, and counts."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._publisher = session.declare_publisher(key)
        self._seq = 0

    def publish(self, **fields: object) -> None:
        """Send the fields behind the header."""
        header = {"stamp_ns": time.time_ns(), "seq": self._seq, "source": NAME, "origin_ns": None}
        self._seq += 1
        self._publisher.put(json.dumps(header | fields))


def last_value(session: zenoh.Session, key: str) -> dict[str, object]:
    """Print and return what the hub keeps of a key."""
    for reply in session.get(key, timeout=2.0):
        if reply.ok is None:
            continue
        about = json.loads(reply.ok.attachment.to_bytes()) if reply.ok.attachment else {}
        if about.get("kept", True):
            value: dict[str, object] = json.loads(reply.ok.payload.to_bytes())
            age_s = (time.time_ns() - about["received_ns"]) * 1e-9
            print(f"last value of {key}: x {value['x_m']} m, {age_s:.3f} s old, message {about['count']}")
            return value
    sys.exit(f"{key}: the hub keeps no value")


def look(session: zenoh.Session, key: str) -> None:
    """Print the size of the next picture: 4 bytes length (little-endian), header in JSON, JPEG."""
    pictures: queue.Queue[bytes] = queue.Queue()
    subscriber = session.declare_subscriber(key, lambda sample: pictures.put(sample.payload.to_bytes()))
    payload = pictures.get(timeout=5.0)
    subscriber.undeclare()
    end = 4 + int.from_bytes(payload[:4], "little")
    header, jpeg = json.loads(payload[4:end]), payload[end:]
    print(f"picture {header['width_px']} x {header['height_px']}, {len(jpeg)} bytes of JPEG, begins {jpeg[:2].hex()}")


def ask_helm(session: zenoh.Session, vessel: str, **fields: object) -> None:
    """Send a request to the helm and print its answer."""
    answers: queue.Queue[dict[str, object]] = queue.Queue()
    subscriber = session.declare_subscriber(
        f"{vessel}/helm/answer", lambda sample: answers.put(json.loads(sample.payload.to_bytes()))
    )
    request_id = f"{NAME}-{time.time_ns()}"
    request = Variable(session, f"{vessel}/operator/request")
    request.publish(request_id=request_id, client=NAME, lease_s=60.0, attended=False, **fields)
    while (answer := answers.get(timeout=5.0))["request_id"] != request_id:
        pass  # somebody else's
    subscriber.undeclare()
    print(f"helm: {'accepted' if answer['accepted'] else 'refused'}: {answer['reason']}")


def main() -> None:
    """Do what the first lines of this file say."""
    endpoint, vessel = (*sys.argv[1:], "tcp/127.0.0.1:7447", "pladypos")[:2]
    session = connect(endpoint)
    token = session.liveliness().declare_token(f"{vessel}/service/{NAME}")  # "I am here"; gone with the session
    state = last_value(session, f"{vessel}/navigation/state")

    states: queue.Queue[dict[str, float]] = queue.Queue()
    session.declare_subscriber(
        f"{vessel}/navigation/state", lambda sample: states.put(json.loads(sample.payload.to_bytes()))
    )
    distance = Variable(session, f"{vessel}/{NAME}/distance")
    for _ in range(10):
        heard = states.get(timeout=5.0)
        distance.publish(left_wall_m=heard["x_m"])
    print(f"10 states, the last of seq {heard['seq']}; published {vessel}/{NAME}/distance")

    heartbeat = Variable(session, f"{vessel}/service/{NAME}/heartbeat")  # once a second in a program that stays
    heartbeat.publish(state="running", pid=os.getpid(), rate_hz=30.0, late_steps=0, step_mean_ms=0.1, step_max_ms=1.0)
    look(session, f"{vessel}/camera/image")
    ask_helm(session, vessel, mode="hold", x_m=state["x_m"], y_m=state["y_m"], psi_rad=state["psi_rad"])
    token.undeclare()
    session.close()


if __name__ == "__main__":
    main()
