"""The compiled solver: C code written from the symbolic model, compiled, kept on disk and called."""
