"""Points: requests in order, evaluation, averaging, compensation, numbering."""
