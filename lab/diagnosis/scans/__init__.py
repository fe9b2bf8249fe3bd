"""Diagnosis of dense scans."""
