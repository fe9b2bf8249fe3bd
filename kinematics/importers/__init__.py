"""Arms from other descriptions: Denavit-Hartenberg tables, URDF, MicroScribe."""
