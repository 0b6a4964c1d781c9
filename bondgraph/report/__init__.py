"""Report: plots, drawings, tables and the self-contained HTML page."""
