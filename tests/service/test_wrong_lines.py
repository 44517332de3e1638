"""Lines that are no requests: every mistake is an answer, and takes no time."""

from __future__ import annotations

import json
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from service_lines import COMFORT, Talk, error_of

from ergoqp.service.lines import DEEPEST, LONGEST_LINE, LineError, read_line

GARBAGE = [b"", b"{", b"[]", b"5", b"null", b'"step"', b"{]", b"\xff\xfe", b"\0", b"{}" * 3]


@pytest.fixture(scope="module")
def shared_talk() -> Talk:
    return Talk()


WRONG_STEPS = {
    "a key": ({"postur": COMFORT}, "got the key 'postur', allowed loop, posture"),
    "31 entries": ({"posture": COMFORT[:31]}, "got 31 entries, allowed 32"),
    "a text": ({"posture": ["0.1", *COMFORT[1:]]}, "trunk_flexion: got '0.1', allowed a number"),
    "a truth": ({"posture": [True, *COMFORT[1:]]}, "trunk_flexion: got True"),
    "a name": ({"posture": {"trunk": 0.1}}, "got the name 'trunk', allowed trunk_flexion"),
    "two units": (
        {"posture": {"neck_twist": 0.1, "neck_twist_deg": 1}},
        "neck_twist in two units",
    ),
    "a word": ({"posture": "upright"}, "posture: got 'upright'"),
    "a pose of 15": ({"pose": [0.0] * 15}, "pose: got 15 entries"),
    "a pose of 4 x 3": ({"pose": [[0.0] * 3] * 4}, "pose, row 1: got 3 entries"),
    "a long quaternion": (
        {"pose": {"position_m": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 2]}},
        "quaternion_xyzw: got the length 2",
    ),
    "no quaternion": ({"pose": {"position_m": [0, 0, 0]}}, "quaternion_xyzw: got None"),
    "a quaternion's key": ({"pose": {"position": [0, 0, 0]}}, "got the key 'position'"),
    "a twist of 5": ({"twist": [0.0] * 5}, "twist: got 5 entries"),
    "a null in a twist": ({"twist": [0.0] * 5 + [None]}, "got None at place 6"),
    "a dt": ({"dt": "1"}, "dt: got '1', allowed a number [s]"),
    "an age": ({"age": None}, "age: got None"),
    "enable": ({"enable": 1}, "enable: got 1, allowed true or false"),
    "hold": ({"hold": "no"}, "hold: got 'no'"),
    "hold and try again": ({"hold": True, "try_again": True}, "hold and try_again"),
    "both": ({"standing": True, "moving": True, "twist": [0.0] * 6}, "standing and moving"),
    "no twist": ({"standing": False, "moving": True}, "moving without"),
    "followed of standing": ({"standing": True, "followed": 1}, "followed with standing"),
    "half a period": ({"followed": 0.5}, "followed: got 0.5"),
    "less than none": ({"followed": -1}, "followed: got -1"),
    "very many": ({"followed": 10**9}, "followed: got 1000000000"),
    "a loop": ({"loop": "overhead"}, "loop: got 'overhead', allowed screwing"),
    "a loop of another kind": ({"loop": 5}, "loop: got 5, allowed screwing"),
}


class TestMistakes:
    @pytest.mark.parametrize("name", WRONG_STEPS)
    def test_step(self, shared_talk, name):
        said, words = WRONG_STEPS[name]
        answer = shared_talk.handler.answer(
            json.dumps({"id": name, "step": {"posture": COMFORT, **said}}).encode()
        )
        told = json.loads(answer.line)
        assert words in error_of(told)
        assert told["id"] == name
        assert answer.bad

    @pytest.mark.parametrize(
        ("line", "words"),
        [
            (b'{"step": {}, "score": {}}', "got 'step', 'score', allowed exactly one of step"),
            (b'{"id": 1}', "got none, allowed exactly one"),
            (b'{"halt": {}}', "got 'halt', allowed exactly one"),
            (b"[1]", "got [1], allowed one JSON object"),
            (b"{", "not JSON"),
            (b"", "not JSON"),
            (b"\xff", "byte 0 is not UTF-8"),
            (b'{"step": NaN}', "got NaN, allowed finite numbers"),
            (b'{"step": -Infinity}', "got -Infinity, allowed finite"),
            (b'{"step": {"dt": 1e999}}', "'1e999', allowed finite"),
            (b'{"step": {"dt": ' + b"9" * 400 + b"}}", "400 digits"),
            (b'{"step": {}, "step": {}}', "the key 'step' twice"),
            (b'{"step": {"dt": 1, "dt": 2}}', "the key 'dt' twice"),
            (b'{"step": ' + b"[" * DEEPEST + b"]" * DEEPEST + b"}", "within another"),
            (b'{"step": []}', "step: got [], allowed an object"),
            (b'{"describe": {"all": 1}}', "got the key 'all', allowed loop"),
            (b'{"health": 3}', "health: got 3, allowed an object"),
            (b'{"id": {}, "describe": {}}', "id: got no text and no number"),
            (b'{"id": "' + b"x" * 300 + b'", "describe": {}}', "300 characters"),
            (b'{"score": {}}', "postures: got None"),
            (b'{"score": {"postures": []}}', "got 0 entries"),
            (b'{"score": {"postures": [[1]]}}', "number 1: got 1 entries, allowed 32"),
            (b'{"load": {"name": "x"}}', "load.problem: got None"),
            (b'{"load": {"problem": ""}}', "load.name: got None"),
            (b'{"load": {"name": "\\ud800", "problem": ""}}', "half of a character"),
            (b'{"load": {"name": "x", "problem": "", "path": "/"}}', "got the key 'path'"),
        ],
    )
    def test_line(self, shared_talk, line, words):
        answer = shared_talk.handler.answer(line)
        assert words in error_of(json.loads(answer.line))
        assert answer.bad

    def test_a_long_line(self, shared_talk):
        line = b'{"describe": {}}'.ljust(LONGEST_LINE)
        assert "loop" in shared_talk.line(line)
        assert f"allowed {LONGEST_LINE}" in error_of(shared_talk.line(line + b" "))

    def test_the_depth_that_is_allowed(self):
        assert read_line(b'{"a": ' + b"[" * (DEEPEST - 1) + b"]" * (DEEPEST - 1) + b"}")
        assert read_line(b'{"a": "' + b"[" * 100 + b'\\"[[[[[[[[[["}')
        with pytest.raises(LineError):
            read_line(b"[" * 500_000)

    @pytest.mark.parametrize("line", [b'"' + b'\\"' * 400_000, b'{"' * 300_000, b'"' * 900_001])
    def test_a_malicious_line_takes_no_time(self, shared_talk, line):
        begun = time.process_time()
        error_of(shared_talk.line(line))
        assert time.process_time() - begun < 2

    def test_many_keys_take_no_time(self, shared_talk):
        keys = ", ".join(f'"k{i}": 0' for i in range(60_000))
        begun = time.process_time()
        assert "twice" in error_of(shared_talk.line(f'{{{keys}, "k59999": 0}}'.encode()))
        assert time.process_time() - begun < 2

    def test_the_connection_goes_on(self):
        talk = Talk()
        first = talk.step(standing=True)
        for line in GARBAGE:
            error_of(talk.line(line))
        assert talk.step()["sequence"] == first["sequence"] + 1

    @given(st.binary(max_size=300) | st.text(max_size=300).map(lambda text: text.encode()))
    @settings(max_examples=300, deadline=None)
    def test_garbage_is_answered_by_an_error(self, shared_talk, line):
        error_of(shared_talk.line(line))

    @given(
        st.dictionaries(
            st.sampled_from(["step", "score", "describe", "health", "load", "id", "x"]),
            st.recursive(
                st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=10),
                lambda inner: (
                    st.lists(inner, max_size=40)
                    | st.dictionaries(
                        st.sampled_from(
                            [
                                "posture",
                                "pose",
                                "twist",
                                "dt",
                                "age",
                                "enable",
                                "hold",
                                "guide",
                                "standing",
                                "moving",
                                "followed",
                                "loop",
                                "try_again",
                                "postures",
                                "load_kg",
                                "name",
                                "problem",
                                "position_m",
                                "quaternion_xyzw",
                                "trunk_flexion",
                                "neck_twist_deg",
                                "seated",
                                "arm_supported",
                            ]
                        )
                        | st.text(max_size=5),
                        inner,
                        max_size=6,
                    )
                ),
                max_leaves=60,
            ),
            max_size=2,
        )
    )
    @settings(max_examples=300, deadline=None)
    def test_what_looks_like_a_request_is_answered(self, shared_talk, request):
        answer = shared_talk.ask(**request)
        assert isinstance(answer, dict)
        assert "internal fault" not in answer.get("error", "")

    def test_a_fault_within_the_service_is_an_answer(self, monkeypatch):
        talk = Talk()
        monkeypatch.setattr(talk.handler, "_describe", lambda said: 1 / 0)
        assert "internal fault, ZeroDivisionError" in error_of(talk.ask(describe={}))
