"""The published interface: documents, and readers in another language."""
