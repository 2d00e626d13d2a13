"""Comparing two arms, and what data can say at all: paired tests, confounds, Fisher information, shrink."""
