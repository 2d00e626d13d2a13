"""What happens to the energies that a detector records: gains, broadening, pile-up, background.

`operation` says what such a change is, `fold` applies several one after the other on the detector's own
channels, `layout` knows these and their groups; the others hold one change each, `gain` beside this folder.
"""
