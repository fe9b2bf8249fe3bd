"""How often the daily check warns, rightly and wrongly."""
