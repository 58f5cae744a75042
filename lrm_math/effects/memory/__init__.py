"""Effects with a memory: what a joint was sent to and bore before."""
