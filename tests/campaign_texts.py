ONE_CONE = """\
schema = "traverse/campaign/1"
poses = "poses.csv"
[[artefacts]]
id = "seat"
kind = "cone"
"""
