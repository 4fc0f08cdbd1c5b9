"""Texts for operators in English and Chinese."""
