"""The method of Conenna 2024 beside ours: its options and its published results."""
