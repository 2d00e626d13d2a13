"""The scan covers the observed band, whatever the redshift of one source; of many, energies are at rest."""

import numpy as np

from gaugeblock.discovery import Candidates, Sources
from gaugeblock.discovery.name.shapes import observed_nodes


def test_a_redshift_does_not_move_what_is_scanned(power_law):
    simulator = power_law()
    line = Candidates.of(simulator, np.array([[1e4, 1.5]]))["line"]
    counts = np.ones((2, 60))
    one = Sources.of(simulator, counts[:1], redshift=1.0)
    np.testing.assert_array_equal(observed_nodes(line, one)[0], line.entry.nodes)
    two = Sources.of(simulator, counts, redshift=np.array([0.0, 1.0]))
    nodes = observed_nodes(line, two)
    np.testing.assert_allclose(nodes[1, :, 0], nodes[0, :, 0] / 2.0)
    np.testing.assert_allclose(nodes[1, :, 1], nodes[0, :, 1])
