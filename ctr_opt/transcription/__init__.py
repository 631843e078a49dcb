"""Transcription of differential equations into algebraic ones."""
