"""The service's answers to lines of JSON: every verb, every mistake, and nothing assumed."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest
from service_lines import COMFORT, Lines, Talk, error_of
from service_running import Running

import ergoqp
from ergoqp import JOINTS, reba
from ergoqp.cli import serve
from ergoqp.errors import ProblemError
from ergoqp.service.door import Handler
from ergoqp.service.lines import LONGEST_LINE, read_line, write_line
from ergoqp.service.served import served
from ergoqp.service.stdio import OwnLoops


@pytest.fixture(scope="module")
def shared_talk() -> Talk:
    return Talk()


class TestStep:
    def test_is_that_of_a_stepper_bit_for_bit(self):
        talk, stepper = Talk(), ergoqp.Stepper(ergoqp.load_problem("screwing"))
        stepper.warm_up()
        rng = np.random.default_rng(0)
        pose = None
        for i in range(60):
            posture = np.array(COMFORT) + 0.02 * rng.normal(size=32)
            more: dict[str, Any] = {}
            if pose is not None and i % 3:
                more["pose"] = pose
            if i % 4 == 1:
                more["twist"] = rng.normal(size=6) * 1e-3
            if i % 5 == 2:
                more["age"] = 0.01
            if i % 7 == 3:
                more["dt"] = 0.012
            if i == 40:
                more["enable"] = False
            expected = stepper.step(posture, **more)
            said = {
                key: each.tolist() if isinstance(each, np.ndarray) else each
                for key, each in more.items()
            }
            got = talk.step(
                posture=posture.tolist(), **({"standing": True} if not i else {}), **said
            )
            pose = expected.pose
            assert got["twist"] == expected.twist.tolist()
            assert got["status"] == expected.status
            assert got["reason"] == expected.reason
            assert got["pose"] == expected.pose.tolist()
            assert got["cost"] == expected.cost
            assert got["gain"] == expected.gain
            assert got["posture_rate"] == expected.posture_rate.tolist()
            assert got["margins"] == expected.margins
            stop = stepper.stop(more.get("dt"))
            assert got["stop"] == stop.tolist()
            np.testing.assert_allclose(
                got["times"], np.arange(1, len(stop) + 1) * more.get("dt", 0.01), rtol=1e-12
            )
            assert got["sequence"] == i + 1

    def test_a_joint_that_is_null_or_absent_is_not_seen(self):
        observed = np.ones(32)
        observed[3] = 0
        stepper = ergoqp.Stepper(ergoqp.load_problem("screwing"))
        posture = np.array(COMFORT)
        expected = stepper.step(posture, observed=observed).twist.tolist()
        zero = posture.copy()
        zero[3] = 0.0
        stepper.reset()
        assert stepper.step(zero).twist.tolist() != expected
        listed = [*COMFORT]
        listed[3] = None
        named = {name: COMFORT[i] for i, name in enumerate(JOINTS) if i != 3}
        for said in (
            listed,
            named,
            {**named, "neck_flexion": None},
            {**named, "neck_flexion_deg": None},
        ):
            assert Talk().step(posture=said, standing=True)["twist"] == expected

    def test_names_that_end_in_deg_are_in_degrees(self):
        talk, degrees = (
            Talk(),
            {f"{name}_deg": math.degrees(q) for name, q in zip(JOINTS, COMFORT, strict=True)},
        )
        by_degrees = talk.step(posture=degrees, standing=True)
        by_radians = talk.step(standing=True)
        np.testing.assert_allclose(by_degrees["twist"], by_radians["twist"], rtol=1e-6, atol=1e-15)

    def test_a_pose_has_three_forms(self):
        talk = Talk()
        pose = np.array(talk.step(standing=True)["pose"])
        turn = np.roll(ergoqp.expressions.quaternion_of(pose[:3, :3]), -1)
        forms = (
            pose.tolist(),
            pose.ravel().tolist(),
            {"position_m": pose[:3, 3].tolist(), "quaternion_xyzw": turn.tolist()},
        )
        for form in forms:
            got = talk.step(pose=form, standing=True)
            np.testing.assert_allclose(got["pose"], pose, atol=1e-9)
            assert got["status"] == "optimal"

    def test_without_posture_it_brakes(self):
        talk = Talk()
        talk.step(standing=True)
        for said in ({}, {"posture": None}):
            answer = talk.ask(step=said)
            assert (answer["status"], answer["reason"]) == ("braking", "no posture arrived")

    def test_numbers_that_are_none_are_null(self):
        answer = Talk().step(standing=True, dt=0)
        assert answer["status"] == "invalid"
        assert "NaN" not in json.dumps(answer)

    def test_hold_and_try_again(self):
        talk = Talk()
        talk.step(standing=True)
        assert talk.step(hold=True)["status"] == "braking"
        assert talk.step(hold=True)["reason"].startswith("held")
        for _ in range(20):
            last = talk.step(try_again=True)
        assert last["status"] == "optimal"

    def test_takes_over_a_moving_robot(self):
        twist = [0.02, 0, 0, 0, 0, 0]
        answer = Talk().step(moving=True, twist=twist)
        stepper = ergoqp.Stepper(ergoqp.load_problem("screwing"))
        stepper.reset(twist)
        assert (
            answer["twist"] == stepper.step(np.array(COMFORT), twist=np.array(twist)).twist.tolist()
        )
        assert answer["twist"][0] > 0.01

    def test_followed_periods_are_braked(self):
        talk, stepper = Talk(), ergoqp.Stepper(ergoqp.load_problem("screwing"))
        stepper.warm_up()
        posture = np.array(COMFORT)
        for i in range(20):
            talk.step(**({"standing": True} if not i else {}))
            stepper.step(posture)
        for _ in range(3):
            stepper.brake()
        assert talk.step(followed=3)["twist"] == stepper.step(posture).twist.tolist()

    def test_a_posture_of_degrees_is_named(self):
        answer = Talk().step(posture=np.degrees(COMFORT).tolist(), standing=True)
        assert answer["status"] == "invalid"
        assert "allowed" in answer["reason"]

    def test_a_guide(self, monkeypatch):
        place = np.array(Talk().step(standing=True)["pose"])
        talk, led = Talk(), list[Any]()
        talk.loops = OwnLoops([served("screwing", guide=place)])
        talk.handler = Handler(talk.loops, None)
        monkeypatch.setattr(ergoqp.Stepper, "guide", lambda self, guide: led.append(guide))
        place[2, 3] -= 0.1
        assert "twist" in talk.step(standing=True)
        assert not led
        for said in (place.tolist(), place.ravel().tolist(), None):
            assert "twist" in talk.step(guide=said)
        # The same place again does not begin the way to it anew.
        assert len(led) == 2
        assert np.array_equal(led[0].pose, place)
        assert (led[0].promise, led[0].firm, led[1]) == (None, False, None)
        assert "step.guide: got 3 entries" in error_of(talk.step(guide=[1, 2, 3]))

    def test_guide_needs_a_loop_with_one(self):
        assert "guide" in error_of(Talk().step(standing=True, guide=None))


class TestNothingIsAssumed:
    def test_the_first_step_needs_a_report(self):
        talk = Talk()
        words = error_of(talk.step())
        assert '"standing"' in words
        assert '"moving"' in words
        assert error_of(talk.step(followed=3)) == words
        assert talk.step(standing=True)["sequence"] == 1

    def test_a_late_step_needs_a_report(self):
        talk = Talk(timed=True)
        talk.step(standing=True)
        talk.clock.now += 0.029
        assert "twist" in talk.step()
        talk.clock.now += 0.0301
        words = error_of(talk.step())
        assert "0.0301 s" in words
        assert '"followed"' in words
        assert '"standing"' in words
        # It stays refused until somebody reports.
        talk.clock.now += 0.001
        assert "error" in talk.step()
        assert "error" in talk.step(followed=0)
        assert "twist" in talk.step(followed=1)

    def test_followed_has_to_tell_of_all_the_time(self):
        talk = Talk(timed=True)
        talk.step(standing=True)
        for _ in range(30):
            talk.clock.now += 0.01
            stop = talk.step()["stop"]
        assert len(stop) > 6
        talk.clock.now += 5.0
        assert '"followed": 3 tells of 0.03 s' in error_of(talk.step(followed=3))
        # It stands at the end of its stop, and any time may pass then.
        assert "twist" in talk.step(followed=len(stop))

    def test_a_period_out_of_range_is_not_that_of_the_stop(self):
        talk = Talk(timed=True)
        talk.step(standing=True)
        for _ in range(20):
            talk.clock.now += 0.01
            talk.step()
        answer = talk.step(dt=5)
        assert answer["status"] == "invalid"
        assert answer["times"][0] == 0.01
        talk.clock.now += 1.0
        assert '"followed": 1 tells of 0.01 s' in error_of(talk.step(followed=1))

    def test_standing_and_moving_need_no_time(self):
        talk = Talk(timed=True)
        for said in ({"standing": True}, {"moving": True, "twist": [0.0] * 6}):
            talk.clock.now += 100
            assert "twist" in talk.step(**said)

    def test_a_refused_step_moves_no_time(self):
        talk = Talk(timed=True)
        talk.step(standing=True)
        for _ in range(4):
            talk.clock.now += 0.01
            error_of(talk.step(nonsense=1))
        error_of(talk.step())

    def test_on_stdio_the_time_says_nothing(self):
        talk = Talk()
        talk.step(standing=True)
        time.sleep(0.1)
        assert "twist" in talk.step()


class TestVerbs:
    def test_describe_and_health(self):
        talk = Talk("screwing", "overhead")
        assert "allowed screwing, overhead" in error_of(talk.ask(describe={}))
        described = talk.ask(describe={"loop": "overhead"}, id=7)
        assert described["id"] == 7
        assert described["loops"] == ["screwing", "overhead"]
        assert described["coordinates"] == list(JOINTS)
        assert described["dt"] == 0.01
        health = talk.ask(health={})["health"]
        assert set(health) == {"screwing", "overhead"}
        assert health["screwing"]["pid"] == os.getpid()
        assert set(talk.ask(health={"loop": "overhead"})["health"]) == {"overhead"}

    def test_a_connection_commands_one_loop(self):
        talk = Talk("screwing", "overhead")
        assert "allowed screwing, overhead" in error_of(talk.step(standing=True))
        assert "twist" in talk.step(loop="overhead", standing=True)
        assert "twist" in talk.step()
        words = error_of(talk.step(loop="screwing", standing=True))
        assert "commands overhead" in words
        assert "open another one" in words

    def test_score(self, shared_talk):
        postures = [COMFORT, np.radians([60, *[0.0] * 31]).tolist(), {"trunk_flexion_deg": 60}]
        answer = shared_talk.ask(score={"postures": postures, "load_kg": 6, "one_leg": True})
        exact = reba.assess(np.array(postures[:2]), load_kg=6, one_leg=True)
        assert answer["final"] == [*exact.final.tolist(), None]
        assert answer["final_low"][:2] == answer["final_high"][:2] == exact.final.tolist()
        assert answer["final_low"][2] < answer["final_high"][2]
        assert answer["reasons"][:2] == [exact.reasons(0), exact.reasons(1)]
        assert answer["final_low"][2] <= exact.final[1] <= answer["final_high"][2]

    @pytest.mark.parametrize(
        ("said", "words"),
        [
            ({"load_kg": -1}, "load_kg: got -1"),
            ({"shock": 1}, "shock: got 1, allowed true or false"),
            ({"coupling": 9}, "coupling: got 9"),
            ({"arm_supported": True}, "allowed [right, left]"),
            ({"postures": [[9.0] * 32]}, "degrees given as radians"),
            ({"postures": [[1e300] * 32]}, "degrees given as radians"),
        ],
    )
    def test_wrong_scores(self, shared_talk, said, words):
        assert words in error_of(shared_talk.ask(score={"postures": [COMFORT], **said}))

    def test_formulate(self, shared_talk):
        problem = ergoqp.load_problem("screwing")
        posture = np.array(COMFORT)
        expected = ergoqp.formulate(problem, ergoqp.initial_state(problem), posture).as_dict()
        answer = shared_talk.ask(formulate={"posture": COMFORT})
        assert answer == json.loads(write_line(expected))
        state = ergoqp.initial_state(problem).tolist()
        pose = np.eye(4)
        pose[:3, 3] = 0.4, 0.0, 1.0
        given = {"dt": 0.02, "age": 0.05, "twist": [0.0] * 6}
        expected = ergoqp.formulate(problem, state, posture, pose, **given).as_dict()
        answer = shared_talk.ask(
            formulate={"posture": COMFORT, "state": state, "pose": pose.tolist(), **given}
        )
        assert answer == json.loads(write_line(expected))
        observed = np.arange(32) != 3
        expected = ergoqp.formulate(problem, None, posture, observed=observed, enable=False)
        seen = [each if i != 3 else None for i, each in enumerate(COMFORT)]
        answer = shared_talk.ask(formulate={"posture": seen, "enable": False})
        assert answer == json.loads(write_line(expected.as_dict()))
        assert shared_talk.ask(formulate={})["status"] == "braking"

    @pytest.mark.parametrize(
        ("said", "words"),
        [
            ({"state": [1.0]}, "state"),
            ({"state": 5}, "formulate.state: got 5, allowed a list of numbers"),
            ({"posture": [1]}, "formulate.posture: got 1 entries, allowed 32"),
            ({"twist": [1]}, "formulate.twist: got 1 entries"),
            ({"enable": 1}, "formulate.enable: got 1"),
            ({"hold": True}, "got the key 'hold', allowed loop"),
        ],
    )
    def test_wrong_formulations(self, shared_talk, said, words):
        assert words in error_of(shared_talk.ask(formulate={"posture": COMFORT, **said}))

    def test_lines_are_read_as_the_same_numbers(self):
        numbers = np.random.default_rng(0).normal(size=600) * 10.0 ** np.arange(-300, 300)
        assert read_line(write_line({"a": numbers.tolist()}))["a"] == numbers.tolist()


class TestLoadInOneProcess:
    def text(self) -> str:
        return served("overhead").text

    def test_it_is_served(self):
        talk = Talk()
        assert talk.ask(load={"name": "mine", "problem": self.text()})["loops"] == [
            "screwing",
            "mine",
        ]
        expected = Talk("overhead").step(standing=True)
        assert talk.step(loop="mine", standing=True)["twist"] == expected["twist"]

    def test_a_loop_in_use_is_not_replaced(self):
        talk = Talk()
        assert talk.ask(load={"name": "screwing", "problem": self.text()})["loaded"] == "screwing"
        talk.step(standing=True)
        words = error_of(talk.ask(load={"name": "screwing", "problem": self.text()}))
        assert words == "loop screwing: commanded by this connection; nothing was replaced"

    def test_names_of_sockets_are_refused(self, shared_talk):
        for name in ("", "../x", "a/b", "a.b", "json", "a" * 65, "a\0b", "é"):
            words = error_of(shared_talk.ask(load={"name": name, "problem": self.text()}))
            assert "problem: got the name" in words

    @pytest.mark.slow
    def test_no_more_than_a_few(self):
        talk = Talk()
        for number in range(8):
            talk.ask(load={"name": f"p{number}", "problem": self.text()})
        assert "allowed 8" in error_of(talk.ask(load={"name": "p9", "problem": self.text()}))


class TestStandardInput:
    def run(self, text: bytes, *arguments: str) -> subprocess.CompletedProcess[bytes]:
        command = [
            sys.executable,
            "-m",
            "ergoqp",
            "serve",
            *(arguments or ("screwing",)),
            "--stdio",
        ]
        return subprocess.run(command, input=text, capture_output=True, timeout=120)

    def test_lines_in_lines_out(self):
        request = json.dumps({"step": {"posture": COMFORT, "standing": True}}).encode()
        lines = [
            request,
            b"{]",
            request[:-1] + b" " * LONGEST_LINE + b"}",
            b'{"id": "last", "describe": {}}',
        ]
        done = self.run(b"\n".join(lines))
        assert done.returncode == 0, done.stderr
        answers = [json.loads(line) for line in done.stdout.splitlines()]
        assert len(answers) == len(lines)
        assert answers[0]["twist"] == Talk().step(standing=True)["twist"]
        assert "not JSON" in answers[1]["error"]
        assert "allowed 1000000" in answers[2]["error"]
        assert answers[3]["id"] == "last"
        assert done.stderr == b""

    def test_the_two_commands_of_the_help(self):
        command = serve.ABOUT[serve.ABOUT.index("  echo ") :]
        shell = command.replace("ergoqp serve", f"{sys.executable} -m ergoqp serve")
        done = subprocess.run(["sh", "-c", shell], capture_output=True, timeout=120)
        assert len(json.loads(done.stdout)["twist"]) == 6, done.stderr

    def test_time_between_lines_says_nothing(self):
        command = [sys.executable, "-m", "ergoqp", "serve", "screwing", "--stdio"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with subprocess.Popen(command, **pipes) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            for said in ({"standing": True}, {}):
                request = json.dumps({"step": {"posture": COMFORT, **said}}).encode()
                process.stdin.write(request + b"\n")
                process.stdin.flush()
                # Every answer comes at once, not with the end of the input.
                assert "twist" in json.loads(process.stdout.readline())
                time.sleep(0.2)
            process.stdin.close()
            assert process.wait(20) == 0

    def test_standard_output_is_json_alone(self):
        program = """
import os
from ergoqp.service import stdio
from ergoqp.service.served import served
class Noisy(stdio.Handler):
    def answer(self, line):
        os.write(1, b"noise of a library\\n")
        print("more noise", flush=True)
        return super().answer(line)
stdio.Handler = Noisy
stdio.serve_stdio([served("screwing")])
"""
        done = subprocess.run(
            [sys.executable, "-c", program],
            input=b'{"health": {}}',
            capture_output=True,
            timeout=120,
        )
        assert set(json.loads(done.stdout)) == {"health"}
        assert done.stderr == b"noise of a library\nmore noise\n"

    def test_no_lines(self):
        done = self.run(b"")
        assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")

    @pytest.mark.parametrize("option", [("--tcp", "0"), ("--workers", "2"), ("--fifo", "3")])
    def test_options_of_sockets_are_refused(self, option):
        done = self.run(b"", "screwing", *option)
        assert done.returncode == 2
        assert b"--stdio" in done.stderr
        assert not done.stdout


class TestBySocket:
    def test_steps_are_those_of_the_binary_door(self, service: Running):
        with Lines.by_unix(service.folder) as lines:
            got = lines.ask(step={"loop": "screwing", "posture": COMFORT, "standing": True})
        with service.client() as client:
            client.reset()
            assert client.step(np.array(COMFORT)).twist.tolist() == got["twist"]

    def test_one_commander_over_all_doors(self, service: Running):
        step = {"loop": "screwing", "posture": COMFORT, "standing": True, "enable": False}
        with Lines.by_unix(service.folder) as lines, Lines.by_unix(service.folder) as other:
            assert "twist" in lines.ask(step=step)
            words = error_of(other.ask(step=step))
            assert words == f"loop screwing: commanded by process {os.getpid()} (JSON) already"
            with service.client() as client:
                client.reset()
                answer = client.step(np.array(COMFORT))
                assert not answer.fresh
                assert "commanded by process" in answer.reason
            # The one that was refused may command once the first has gone.
            lines.close()
            until = time.monotonic() + 10
            while "error" in (answer := other.ask(step=step)):
                assert time.monotonic() < until, answer
            with service.client() as client:
                client.reset()
                assert not client.step(np.array(COMFORT)).fresh
        with service.client() as client:
            until = time.monotonic() + 10
            client.reset()
            while not client.step(np.array(COMFORT), enable=False).fresh:
                assert time.monotonic() < until
                client.reset()
            with Lines.by_unix(service.folder) as lines:
                words = error_of(lines.ask(step=step))
                assert words == f"loop screwing: commanded by process {os.getpid()} already"

    def test_a_late_client_has_to_report(self, service: Running):
        with Lines.by_unix(service.folder) as lines:
            step = {"loop": "screwing", "posture": COMFORT}
            lines.ask(step={**step, "standing": True})
            time.sleep(0.2)
            assert "s passed since the last twist" in error_of(lines.ask(step=step))
            assert "twist" in lines.ask(step={**step, "followed": 100})


def test_a_loop_cannot_have_the_name_of_the_socket(tmp_path):
    path = tmp_path / "json.toml"
    path.write_text(served("screwing").text)
    with pytest.raises(ProblemError, match="'json'"):
        served(str(path))
