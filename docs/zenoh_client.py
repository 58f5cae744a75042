"""Moves an arm with zenoh and msgpack alone: `python zenoh_client.py [ENDPOINT [ROBOT]]`. The interface: docs/api.md.

It waits for the board, takes the lease, arms the arm where a person says that it is (here: at zero), moves joint1 by
0.1 rad and back, and gives the lease up. The pulses stay on: the arm stands.
"""

import sys
import threading
import time

import msgpack
import zenoh

ENDPOINT = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
ROBOT = sys.argv[2] if len(sys.argv) > 2 else "rover"


class Refused(Exception):
    """The daemon's error reply: `code`, `msg`, `retryable`, `detail`."""

    def __init__(self, error):
        self.code, self.retryable = error["code"], error["retryable"]
        super().__init__(f"{error['code']}: {error['msg']}")


def ask(session, tail, timeout=5.0, **fields):
    """One query; the reply as a map. Raises `Refused` on an error reply, `TimeoutError` if there is no reply."""
    key = f"lrm/{ROBOT}/{tail}"
    for reply in session.get(key, payload=msgpack.packb({"v": 1, **fields}), timeout=timeout):
        if reply.ok is not None:
            return msgpack.unpackb(reply.ok.payload.to_bytes())
        try:
            error = msgpack.unpackb(reply.err.payload.to_bytes())
        except ValueError:
            error = None
        if isinstance(error, dict):
            raise Refused(error)
        break  # zenoh's own error: plain text, "Timeout"
    raise TimeoutError(f"no answer from {key}: no such robot, no permission, or not in time")


def wait_for(session, what, seconds=10.0):
    """Waits until `what(state/mode)` holds, and returns that state."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        mode = ask(session, "state/mode")
        if what(mode):
            return mode
        time.sleep(0.02)
    raise TimeoutError(f"mode {mode['mode']}, link {mode['link']}, {mode['troubles']}")


class Lease:
    """Holds the lease while the block runs. In a real program renew it from the main loop, not from a thread."""

    def __init__(self, session, holder):
        reply = ask(session, "rpc/lease", action="acquire", holder=holder)
        self.session, self.token, self.ended = session, reply["lease"], threading.Event()
        self.thread = threading.Thread(target=self.renew, args=(reply["lease_ms"] / 4000,))
        self.thread.start()

    def renew(self, period):
        while not self.ended.wait(period):
            try:
                ask(self.session, "rpc/lease", timeout=0.3, action="renew", lease=self.token)
            except (Refused, TimeoutError) as error:
                print("lease:", error, file=sys.stderr)

    def __enter__(self):
        return self.token

    def __exit__(self, *_):
        self.ended.set()
        self.thread.join()
        try:
            ask(self.session, "rpc/lease", action="release", lease=self.token)
        except (Refused, TimeoutError) as error:
            print("lease:", error, file=sys.stderr)


def move(session, token, angles):
    """Moves servos to angles (rad by name) and waits until they are there."""
    began = ask(session, "rpc/move", lease=token, waypoints=[angles])
    mode = wait_for(session, lambda mode: mode["mode"] != "moving", 2 * began["seconds"] + 5)
    if mode["mode"] != "armed":
        raise RuntimeError(f"the motion ended before its goal: {mode['mode']} ({mode['why']})")


def main():
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{ENDPOINT}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    with zenoh.open(config) as session:  # without `with`, or close(), a program with subscribers hangs at its end
        info = ask(session, "info")
        joints = info["names"][: info["joints"]]
        print(f"{info['robot']}: arm {info['arm']}, joints {', '.join(joints)}")
        seen = []
        session.declare_subscriber(
            f"lrm/{ROBOT}/state/joints", lambda sample: seen.append(msgpack.unpackb(sample.payload.to_bytes()))
        )
        wait_for(session, lambda mode: mode["link"] == "ready")
        with Lease(session, "zenoh_client.py") as token:
            ask(session, "rpc/arm", lease=token, where="given", q_rad=dict.fromkeys(joints, 0.0))
            wait_for(session, lambda mode: mode["mode"] == "armed")
            move(session, token, {joints[0]: 0.1})
            try:
                move(session, token, {joints[0]: 10.0})
            except Refused as error:
                print("as it should be,", error)
            move(session, token, {joints[0]: 0.0})
        print(f"{len(seen)} states; the largest angle of {joints[0]} was {max(s['q_rad'][0] for s in seen):.3f} rad")


if __name__ == "__main__":
    main()
