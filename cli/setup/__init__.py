"""`traverse setup`: the files of a daemon made and changed in a browser."""
