"""What everything stands on: errors, files, text from elsewhere, numbers, cores."""
