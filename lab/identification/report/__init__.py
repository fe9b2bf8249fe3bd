"""The report of an identification: words, pictures and one page that holds them."""
