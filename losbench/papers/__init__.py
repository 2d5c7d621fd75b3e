"""The papers: their scenarios, and one function per figure and table."""
