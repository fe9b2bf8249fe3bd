"""`traverse joints`: guided bring-up of an arm's encoders."""
