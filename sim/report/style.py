"""How the report looks: one style sheet for screen and A4 paper, and the policy that lets a browser load nothing but it and the pictures."""

from __future__ import annotations

import base64
import hashlib

STYLE = """
:root{--ink:#1b2027;--soft:#56606c;--rule:#c9cfd6;--field:#f4f6f8;--good:#12663a;--bad:#9c1c1c;--warn:#7a5200;--blue:#1f5fa8;--orange:#b4520d}
*{box-sizing:border-box}
body{font:10.5pt/1.42 "Helvetica Neue",Arial,"Liberation Sans",sans-serif;color:var(--ink);background:#fff;
max-width:186mm;margin:8mm auto;padding:0 4mm}
h1{font-size:19pt;line-height:1.15;margin:0 0 1mm;overflow-wrap:anywhere}
h2{font-size:12.5pt;margin:7mm 0 2mm;padding-bottom:.8mm;border-bottom:.5mm solid var(--ink);break-after:avoid}
h3{font-size:10.5pt;margin:0 0 1mm;break-after:avoid}
p{margin:0 0 2mm}
.kind{letter-spacing:.06em;text-transform:uppercase;font-size:8.5pt;color:var(--soft);margin:0 0 1mm}
.soft{color:var(--soft);font-size:9pt}
.pairs{break-inside:avoid;display:grid;grid-template-columns:1fr 1fr;gap:0 8mm;margin:3mm 0 0}
.pairs div{display:flex;gap:3mm;border-bottom:.2mm solid var(--rule);padding:.7mm 0}
.pairs dt{flex:0 0 33mm;color:var(--soft)}
.pairs dd{margin:0;overflow-wrap:anywhere;min-width:0}
.wide{grid-column:1/-1}
.hash,code{font-family:"Liberation Mono",Menlo,Consolas,monospace;font-size:8.5pt}
.verdict{border:.9mm solid;padding:3mm 4mm;margin:5mm 0 3mm;break-inside:avoid}
.verdict strong{display:block;font-size:21pt;line-height:1.2;letter-spacing:.02em}
.verdict.passed{border-color:var(--good)}.verdict.passed strong{color:var(--good)}
.verdict.failed{border-color:var(--bad)}.verdict.failed strong{color:var(--bad)}
.verdict ul{margin:1.5mm 0 0;padding-left:5mm}
.verdict li{overflow-wrap:anywhere}
table{border-collapse:collapse;width:100%;margin:0 0 3mm;font-size:9.5pt}
th,td{text-align:left;vertical-align:top;padding:.75mm 1.6mm;border-bottom:.2mm solid var(--rule);overflow-wrap:break-word}
th{font-weight:600;background:var(--field);border-bottom-color:var(--ink)}
thead{display:table-header-group}
tr{break-inside:avoid}
.figure{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
.ok{color:var(--good);font-weight:600;white-space:nowrap}
.not-ok,.error{color:var(--bad);font-weight:700;white-space:nowrap}
.warning{color:var(--warn);font-weight:700;white-space:nowrap}
figure{margin:0 0 2mm;break-inside:avoid}
figure img,svg{display:block;width:100%;height:auto}
figcaption{font-size:9pt;color:var(--soft);margin-top:1mm}
.places{display:grid;grid-template-columns:1fr 1fr;gap:5mm}
.place{break-inside:avoid;margin:0}
.place h3{overflow-wrap:anywhere}
.place p{font-size:9pt;margin:1mm 0;overflow-wrap:anywhere}
pre{margin:1mm 0 0;padding:1.2mm 2mm;background:var(--field);border-left:.6mm solid var(--rule);
font:8pt/1.35 "Liberation Mono",Menlo,Consolas,monospace;
white-space:pre-wrap;overflow-wrap:anywhere}
pre b{display:block;background:#fbe3c8}
table.named{font-size:7.8pt;line-height:1.3}table.findings{table-layout:fixed}
.findings th:nth-child(1){width:8mm}.findings th:nth-child(2){width:20mm}.findings th:nth-child(5){width:18mm}.findings th:nth-child(6){width:13mm}
.findings th:nth-child(-n+2),.named td:first-child{white-space:nowrap}
.beside{display:grid;grid-template-columns:84mm 1fr;gap:6mm;align-items:start}
.sign{display:grid;grid-template-columns:1fr 1fr;gap:8mm 12mm;margin-top:2mm;break-inside:avoid}
.sign div{border-top:.3mm solid var(--ink);padding-top:1mm;font-size:9pt;color:var(--soft);margin-top:11mm}
ul.plain{break-inside:avoid;break-before:avoid;margin:0 0 2mm;padding-left:5mm}ul.plain li{margin-bottom:.8mm}
svg text{font-family:"Helvetica Neue",Arial,"Liberation Sans",sans-serif;font-size:10px;fill:#1b2027}
svg .tick{font-size:9.5px;fill:#3d4650}svg .note{font-size:9.5px;paint-order:stroke;stroke:#fff;stroke-width:3px;stroke-linejoin:round}
svg .end{text-anchor:end}svg .middle{text-anchor:middle}
svg .frame{fill:none;stroke:#56606c;stroke-width:.8}svg .grid{stroke:#dfe3e8;stroke-width:.6}
svg .limit{fill:none;stroke:#9c1c1c;stroke-width:1.2;stroke-dasharray:7 3}svg .zero{stroke:#1b2027;stroke-width:.8}
svg .layer{stroke:#9aa3ad;stroke-width:.5}
svg .set{fill:none;stroke:#b4520d;stroke-width:.9;stroke-dasharray:4 2.5}
svg .is{fill:none;stroke:#1f5fa8;stroke-width:1.1;stroke-linejoin:round}
svg .range{fill:#1f5fa8;fill-opacity:.22;stroke:none}
svg .key-range{stroke:#1f5fa8;stroke-opacity:.3;stroke-width:8}
svg .key-missing{stroke:#2f78c4;stroke-width:8}svg .key-excess{stroke:#c8743a;stroke-width:8}
svg .bar{fill:#7f93a8;stroke:none}svg .bar-out{fill:#9c1c1c;stroke:#5a0d0d;stroke-width:.5}
svg .bar-excess{fill:#c8743a;stroke:none}svg .bar-missing{fill:#2f78c4;stroke:none}
svg .fault{fill:#9c1c1c;stroke:#fff;stroke-width:1}svg .fault-text{fill:#fff;font-size:9px;font-weight:700}
svg .path-near{fill:none;stroke:#1b2027;stroke-width:.7;stroke-opacity:.65}
svg .path-halo{fill:none;stroke:#fff;stroke-width:4.5;stroke-opacity:.9;stroke-linecap:round}
svg .path-here{fill:none;stroke:#111;stroke-width:2.2;stroke-linecap:round}
svg .mark-halo{fill:none;stroke:#fff;stroke-width:5}svg .mark{fill:none;stroke:#c01414;stroke-width:2}
svg .body-tool{fill:#1f5fa8;fill-opacity:.16;stroke:#123f73;stroke-width:1.3;stroke-linejoin:round}
svg .body-met{fill:#7a5200;fill-opacity:.14;stroke:#7a5200;stroke-width:1.3;stroke-dasharray:5 2}
svg .tool-axis{fill:none;stroke:#123f73;stroke-width:1;stroke-dasharray:9 3 2 3}svg .tip{fill:#fff;stroke:#123f73;stroke-width:1.4}
svg .paper{fill:#fff;fill-opacity:.82}svg .ruler{fill:none;stroke:#1b2027;stroke-width:1.6}
@page{size:A4;margin:14mm 12mm}
@media print{body{margin:0;padding:0;max-width:none;font-size:9.5pt;-webkit-print-color-adjust:exact;print-color-adjust:exact}
table{font-size:8.8pt}}
@media (max-width:640px){.pairs,.places,.beside{grid-template-columns:1fr}}
"""

_DIGEST = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()

PAGE_POLICY = f"default-src 'none'; img-src data:; style-src 'sha256-{_DIGEST}'; base-uri 'none'; form-action 'none'"
"""Content-Security-Policy that the page itself carries: no script, nothing from outside, no style but this one."""
