"""Pages: one file for each page, and the data and facts about folds that pages show."""
