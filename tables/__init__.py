"""Tables as people have them: text with a header, in many dialects, one reader."""
