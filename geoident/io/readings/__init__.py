"""Readings as sites have them: CSV, spreadsheets with one column a gauge, AGS4."""
