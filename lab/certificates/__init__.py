"""Digital calibration certificates: what a laboratory signs and a machine checks."""
