"""Ports and threads: bytes in, stamped blocks of counts out."""
