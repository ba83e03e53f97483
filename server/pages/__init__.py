"""Pages: one file for each page, and the facts about folds that pages show."""
