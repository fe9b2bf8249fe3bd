"""Getting in at an MQTT broker, or hearing in words why not.

What the daemon and clients outside have in common: how a line is encrypted, and what
its end, a broker's refusal and the errors of OpenSSL mean to people. Knows nothing of
arms.
"""
