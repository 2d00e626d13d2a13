"""Where simulator, estimator, validators and policy meet: collect trials, judge them, report, verify."""
