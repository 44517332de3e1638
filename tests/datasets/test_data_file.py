import numpy as np
import pytest

from ergoqp.datasets.data import read_data
from ergoqp.errors import ModelError


def written(tmp_path, text):
    path = tmp_path / "mine.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_in_any_order_and_unit(tmp_path):
    data = read_data(written(tmp_path, "score,trunk_flexion_deg,neck_twist\n3,30,0.1\n1,0,-0.2\n"))
    assert data.coordinates == ("trunk_flexion", "neck_twist")
    assert data.points == pytest.approx(np.array([[np.radians(30), 0.1], [0.0, -0.2]]))
    assert data.labels.tolist() == [3.0, 1.0]
    assert data.source == "mine.csv"


def test_points_of_the_forearm(tmp_path):
    data = read_data(
        written(
            tmp_path, "elbow_x,elbow_y,elbow_z,wrist_x,wrist_y,wrist_z,score\n0,0,0,0.2,0,0,4\n"
        )
    )
    assert data.points.shape == (1, 6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "score,trunk_bend\n1,2\n",
            "got a column 'trunk_bend', allowed joints such as 'trunk_flexion'",
        ),
        ("trunk_flexion\n0.1\n", "got 0 columns named 'score', allowed exactly one"),
        ("score,score,trunk_flexion\n1,1,0.1\n", "got 2 columns named 'score'"),
        ("score,trunk_flexion\n", "got a header and no posture, allowed a header and at least"),
        ("", "got nothing, allowed a header and at least one posture"),
        ("score,trunk_flexion\n1,0.1\n-1,0.2\n", "line 3 has the score -1, allowed 0 to 15"),
        ("score,trunk_flexion\n1,0.1\n102,0.2\n", "line 3 has the score 102, allowed 0 to 15"),
        ("score,trunk_flexion\n1,a\n", "line 2 holds 'a', allowed numbers"),
        ("score,trunk_flexion\n1,0.1\n1\n", "line 3 has 1 entries, allowed 2"),
        ("score,trunk_flexion\n1,0.1\n2,nan\n", "row 1 is not finite"),
        ("score,trunk_flexion\n1,30\n", "line 2 has an angle beyond ±π rad"),
        ("score,trunk_flexion,elbow_x\n1,0.1,0.2\n", "got 'elbow_x' among joints"),
        ("score,trunk_flexion,trunk_flexion_deg\n1,0.1,3\n", "each once"),
    ],
)
def test_one_sentence_per_mistake(tmp_path, text, said):
    with pytest.raises((ModelError, ValueError)) as caught:
        read_data(written(tmp_path, text))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_none(tmp_path):
    with pytest.raises(ModelError, match="cannot be read"):
        read_data(tmp_path / "absent.csv")
    path = tmp_path / "binary.csv"
    path.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ModelError, match="not a CSV file"):
        read_data(path)
