"""What people read: tables on the terminal and in files, the model card."""
