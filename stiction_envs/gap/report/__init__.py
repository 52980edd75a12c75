"""Diagnoses for people: verdict, report, pictures and model files, of logs and of tables."""
