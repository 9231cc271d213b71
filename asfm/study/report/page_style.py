"""Style of a study's report: legible from 400 pixels to print."""

STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; margin: 0 auto; padding: 0 16px 48px;
  max-width: 1360px; overflow-wrap: anywhere; }
h1 { font-size: 1.7em; } h2 { font-size: 1.3em; margin-top: 2em; border-bottom: 1px solid #ccc; }
h3 { font-size: 1.05em; margin: 0.4em 0; }
p, li { max-width: 80ch; }
nav { display: flex; flex-wrap: wrap; gap: 4px 20px; }
.figures { display: grid; gap: 32px 24px; grid-template-columns: repeat(auto-fill, minmax(min(100%, 400px), 1fr)); }
.pictures { display: grid; gap: 16px; grid-template-columns: repeat(auto-fill, minmax(min(100%, 320px), 1fr)); }
figure { margin: 0; } figure svg { width: 100%; height: auto; max-width: 560px; display: block; }
.pictures { margin: 16px 0; } .pictures svg { border: 1px solid #ddd; box-sizing: border-box; }
.pictures path { fill: none; stroke-width: 1.4; stroke-linecap: round; }
path.correct { stroke: #0072b2; stroke-opacity: 0.75; }
path.wrong { stroke: #d55e00; stroke-width: 2; stroke-dasharray: 5 4; }
.shared { position: absolute; }
figcaption { font-size: 0.88em; color: #444; max-width: 70ch; }
.wide { overflow: auto; max-height: 80vh; }
table { border-collapse: collapse; font-size: 0.85em; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 8px; text-align: left; border-bottom: 1px solid #e2e2e2; white-space: nowrap; }
th { background: #f4f4f4; position: sticky; top: 0; }
pre { background: #f6f6f6; padding: 12px; font-size: 0.8em; overflow-x: auto; white-space: pre-wrap; }
summary { cursor: pointer; padding: 6px 0; font-weight: 600; }
@page { size: A4; margin: 14mm; }
@page broad { size: A4 landscape; margin: 10mm; }
@media print {
  body { font-size: 10pt; max-width: none; padding: 0; }
  nav { display: none; } a { color: inherit; text-decoration: none; }
  details::details-content { content-visibility: visible; display: block; }
  .sequence { break-before: page; }
  h2, h3, summary { break-after: avoid; } figure, tr { break-inside: avoid; } thead { display: table-header-group; }
  .figures { grid-template-columns: 1fr 1fr; } .pictures { grid-template-columns: 1fr 1fr; }
  .wide { overflow: visible; max-height: none; } th { position: static; }
  th, td { white-space: normal; overflow-wrap: normal; padding: 2px 4px; } table { font-size: 7pt; }
  .cells { page: broad; } .cells table { font-size: 5.5pt; } .cells th, .cells td { padding: 1px 2px; }
  pre { font-size: 7pt; }
}
"""
