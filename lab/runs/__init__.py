"""From a campaign's folder to the files of its result: for commands and fleets."""
