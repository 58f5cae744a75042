"""The method of Conenna 2024 beside ours: its options, its published results, its step of differences."""
