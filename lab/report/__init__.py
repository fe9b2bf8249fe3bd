"""Common parts of the lab's reports: page, HTML, look of the pictures."""
