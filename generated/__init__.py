"""Generated modules, one for each model: checked in, reviewed as a diff, never edited."""
