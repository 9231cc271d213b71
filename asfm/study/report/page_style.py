"""Style of a study's report: legible from 400 pixels to print."""

STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; margin: 0 auto; padding: 0 16px 48px;
  max-width: 1360px; overflow-wrap: anywhere; }
h1 { font-size: 1.7em; } h2 { font-size: 1.3em; margin-top: 2em; border-bottom: 1px solid #ccc; }
h3 { font-size: 1.05em; margin: 0.4em 0; }
p, li { max-width: 80ch; }
.figures { display: grid; gap: 24px; grid-template-columns: repeat(auto-fill, minmax(min(100%, 400px), 1fr)); }
figure { margin: 0; } figure svg { width: 100%; height: auto; max-width: 560px; display: block; }
figcaption { font-size: 0.88em; color: #444; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.85em; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 8px; text-align: left; border-bottom: 1px solid #e2e2e2; white-space: nowrap; }
th { background: #f4f4f4; position: sticky; top: 0; }
pre { background: #f6f6f6; padding: 12px; font-size: 0.8em; overflow-x: auto; white-space: pre-wrap; }
summary { cursor: pointer; padding: 4px 0; }
@media print { body { font-size: 10pt; max-width: none; } figure, tr { break-inside: avoid; }
  .figures { grid-template-columns: 1fr 1fr; } th, td { white-space: normal; padding: 2px 4px; }
  .wide { overflow: visible; }
  table { font-size: 7pt; } }
"""
