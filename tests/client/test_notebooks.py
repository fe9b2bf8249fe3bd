from html.parser import HTMLParser

import pandas as pd

from tests.protocol.message_examples import POINT
from traverse import Point, to_pandas
from traverse.protocol.messages import Quality

DOUBTFUL = Quality(ok=False, flags=("skewed",))


def point(**changes) -> Point:
    return POINT.model_copy(update=changes)


def test_a_frame_has_a_row_for_each_point_and_the_columns_of_csv():
    first = point(time_ns=1_700_000_000_123_456_789, quality=Quality(ok=True, flags=()))
    second = point(seq=POINT.seq + 1, id="other", quality=DOUBTFUL)
    frame = to_pandas(iter([first, second]))
    assert list(frame["id"]) == [POINT.id, "other"]
    assert frame["time_utc"][0] == pd.Timestamp(
        "2023-11-14 22:13:20.123456789", tz="UTC"
    )
    assert frame[frame["ok"]]["id"].tolist() == [POINT.id]
    assert frame[["x_mm", "y_mm", "z_mm"]].to_numpy()[0].tolist() == list(POINT.xyz_mm)


def test_no_points_are_a_frame_without_rows():
    assert "x_mm" in to_pandas([])
    assert len(to_pandas([])) == 0


class Text(HTMLParser):
    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts, self.tags = [], set()
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)

    def handle_data(self, data):
        self.texts.append(data)


def test_a_notebook_shows_coordinates_with_their_uncertainty():
    covariance_mm2 = (0.01**2, 0, 0, 0.02**2, 0, 0.03**2)
    shown = Text(point(xyz_mm=(1, 2, 3), covariance_mm2=covariance_mm2)._repr_html_())
    assert shown.texts[-9:] == [
        *("x", "1.0000 mm", "0.0200 mm", "y", "2.0000 mm", "0.0400 mm"),
        *("z", "3.0000 mm", "0.0600 mm"),
    ]


def test_a_notebook_shows_doubts_and_no_markup_of_others():
    doubtful = point(session="<script>", covariance_mm2=None, quality=DOUBTFUL)
    shown = Text(doubtful._repr_html_())
    assert "script" not in shown.tags
    assert "in doubt: skewed" in shown.texts[0]
    assert shown.texts.count("unknown") == 3
