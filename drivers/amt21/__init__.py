"""Driver of Same Sky (CUI) AMT21 encoders on an RS-485 line."""
