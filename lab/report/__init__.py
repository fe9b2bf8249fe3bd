"""What all reports of the lab share: page, HTML, look of the pictures."""
