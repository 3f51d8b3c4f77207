"""Reports: tables on the terminal and in files, and the model card."""
