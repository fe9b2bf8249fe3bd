"""The report of a diagnosis: words, pictures and one page that holds them."""
