from gaugeblock.simulators.prior import Prior


def as_prior(prior, names=None):
    assert isinstance(prior, Prior)
    return prior
