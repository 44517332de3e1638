"""A command line's outcome, and what a user's mistake looks like in it."""


class Outcome:
    def __init__(self, status, out, err):
        self.status, self.out, self.err = status, out, err


def mistake(outcome):
    """The one sentence on standard error of a user's mistake."""
    assert outcome.status == 2, outcome.err
    lines = [line for line in outcome.err.splitlines() if not line.endswith(" ...")]
    assert len(lines) == 1, outcome.err
    assert lines[0].startswith("ergoqp: ")
    assert "Traceback" not in outcome.err
    return lines[0]
