"""What displays of an arm show, whatever they show it on."""
