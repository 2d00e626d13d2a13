import numpy as np

from gaugeblock.discovery.locate import FittedCounts, channel_scores


def test_channel_scores_have_unit_variance_after_the_fit(power_laws):
    # Four channels and two parameters: without the correction their variance would be about a half.
    data = power_laws(5, n=3000, channels=4, total=2000.0)
    rows = zip(data.counts, data.expected, data.jacobian, strict=True)
    scores = np.array([channel_scores(FittedCounts.of(*row)) for row in rows])
    np.testing.assert_allclose(scores.var(axis=0), 1.0, atol=4.5 * np.sqrt(2 / 3000))
    pearson = (data.counts - data.expected) / np.sqrt(data.expected)
    assert pearson.var() < 0.6
