"""A daemon as its tests run it: its process, a board, clients, and what the board was told."""
