"""Data that nobody divides are one run of channels."""

from gaugeblock.simulators.segments import Segment, segments


def test_what_says_nothing_of_its_data_is_one_segment_of_channels():
    (found,) = segments(object(), 3)
    assert (found.name, found.start, found.stop, found.unit, found.role) == (
        "data",
        0,
        3,
        "channel",
        "source",
    )
    assert found.edges.tolist() == [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]]


def test_what_knows_its_segments_is_asked():
    class Own:
        def segments(self):
            return (Segment("a", 0, 1, [[0.0, 1.0]]), Segment("b", 1, 2, [[5.0, 6.0]], role="background"))

    assert [each.name for each in segments(Own(), 2)] == ["a", "b"]
