"""Faults of known size, put into the draws of an audit: which of them would it have caught?"""
