"""From a trial to what is identified from it: rates, held commands, runs through one filter."""
