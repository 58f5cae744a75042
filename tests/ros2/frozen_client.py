"""Client of the action as a process: `python -m tests.ros2.frozen_client ENDPOINT TOKEN`, with ZID in TOKEN."""

import json
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
        time.sleep(600)
        token.undeclare()


if __name__ == "__main__":
    main()
