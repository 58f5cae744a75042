"""Node of ROS 2 as a process, that is frozen: `python -m tests.ros2.frozen_client ENDPOINT TOKEN`, with ZID in TOKEN.

Each line of its standard input is a key, a payload and an attachment (hexadecimal): it publishes them, and freezes at
once, with what it sent perhaps still inside.
"""

import json
import os
import signal
import sys
import time

import zenoh


def main() -> None:
    """Declares the token, says so, and stays."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("adminspace/enabled", "true")
    with zenoh.open(config) as session:
        token = session.liveliness().declare_token(sys.argv[2].replace("ZID", str(session.info.zid())))
        print("there", flush=True)
        for line in sys.stdin:
            key, payload, attachment = line.split()
            session.put(key, bytes.fromhex(payload), attachment=bytes.fromhex(attachment))
            os.kill(os.getpid(), signal.SIGSTOP)
        time.sleep(600)
        token.undeclare()


if __name__ == "__main__":
    main()
