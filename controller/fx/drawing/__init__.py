"""Ladder diagrams and step charts as SVG."""
