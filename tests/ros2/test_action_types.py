"""Types of services and actions: their hashes are those that ROS 2 publishes, and CDR goes there and back."""

from __future__ import annotations

import pytest

from lrm_ros2.action_types import CANCEL_GOAL, FEEDBACK, GET_RESULT, SEND_GOAL, TRIGGER, action_texts
from lrm_ros2.message_types import add_types, message_type, type_hash, type_store

pytest.importorskip("rosbags", reason="rosbags is not installed (lrm-ros2)")
dynamic = pytest.importorskip("mcap_ros2._dynamic", reason="mcap-ros2-support is not installed")


def test_hashes_of_services_are_those_of_ros() -> None:
    assert type_hash(TRIGGER, "jazzy") == "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
    assert type_hash(f"{TRIGGER}_Event", "jazzy").startswith("RIHS01_ec4a1d26b0575e61906890342aba9523a2360e98")
    assert type_hash(TRIGGER, "humble") == "TypeHashNotSupported"


def test_hashes_of_an_action_that_is_known_are_those_of_ros() -> None:
    """The same composition, for the action of the tutorials."""
    from rosbags.typesys import Stores, get_typestore

    action = "example_interfaces/action/Fibonacci"
    store = get_typestore(Stores.ROS2_JAZZY)
    texts = action_texts(action, "int32 order", "int32[] sequence", "int32[] sequence")
    add_types(store, texts, (f"{action}_SendGoal", f"{action}_GetResult"))
    known = {
        "SendGoal": "RIHS01_d1a57fb2a4afe8c21e34fb10db206f16ce6729b28531141472df92277c55b557",
        "GetResult": "RIHS01_1b0de0d5d29dc955d92f546706568428632771db13ec84c15ec1c1a59f424a57",
        "FeedbackMessage": "RIHS01_c1de71afd52e49a89c53d8262366884185bc0a02f78ce051c4e46b0a7fe59bb2",
    }
    assert {part: store.hash_rihs01(f"{action}_{part}") for part in known} == known


@pytest.mark.parametrize("distribution", ["humble", "jazzy", "kilted"])
def test_an_independent_decoder_reads_what_the_store_writes(distribution: str) -> None:
    store, of = type_store(distribution), message_type(f"{TRIGGER}_Response", distribution)
    data = bytes(store.serialize_cdr(store.types[of.name](success=True, message="held"), of.name))
    read = dynamic.generate_dynamic(of.name, of.text)[of.name](data)
    assert (read.success, read.message) == (True, "held")
    for name in (f"{SEND_GOAL}_Request", f"{GET_RESULT}_Response", f"{CANCEL_GOAL}_Response", FEEDBACK):
        assert message_type(name, distribution).text
