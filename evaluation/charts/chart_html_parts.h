// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace forcegrid::evaluation {

/// Parts of a chart's page that do not depend on its data. The title goes between the first two.
/// The script reads `names` (of the columns), `rows`, and `filterColumns`, the number of leading
/// columns with a filter.
inline constexpr char kHtmlHead[] = R"html(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>)html";

inline constexpr char kHtmlStyle[] = R"html(</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body{font:15px/1.5 system-ui,sans-serif;color:#222;background:#fff;max-width:1700px;margin:1em auto;padding:0 1em}
h1{font-size:1.6em;margin:0.4em 0}h2{margin-top:2em;border-bottom:1px solid #ddd}
table{border-collapse:collapse;font-variant-numeric:tabular-nums;font-size:13px;margin:1em 0;display:block;overflow-x:auto}
th,td{padding:3px 9px;text-align:right;white-space:nowrap;border-bottom:1px solid #eee}
th:first-child,td:first-child,td:nth-child(2),th:nth-child(2){text-align:left}
th{cursor:pointer;background:#f5f5f7;position:sticky;top:0;white-space:normal;vertical-align:bottom}
th.words{text-align:left}
table.tight{font-size:11px}table.tight th,table.tight td{padding:3px;white-space:normal}
table.tight th:first-child,table.tight td:first-child,table.tight td:nth-child(2){overflow-wrap:anywhere;min-width:7em}
table.tight small{white-space:nowrap}table.tight .missed{font-weight:400}
tr:hover td{background:#f7faff}
tr.front td:first-child{font-weight:600;color:#0b5394}
.met{color:#1a7f37}.near{color:#9a6700}.missed{color:#c0392b;font-weight:600}.none{color:#888}
.lead{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(600px,100%),1fr));gap:1em;margin:0.5em 0}
.lead figure{margin:0}.lead figcaption{min-height:3em}
td.words,td.reason{white-space:normal;text-align:left;min-width:15em;overflow-wrap:anywhere}
small{color:#888}svg{max-width:100%;height:auto}
select{margin-right:1em}code{background:#f5f5f7;padding:0 3px}
</style></head><body>
)html";

inline constexpr char kHtmlAllRows[] = R"html(<h2>All rows</h2>
<p id="filters"></p><p id="count"></p><table id="all"><thead></thead><tbody></tbody></table>
)html";

inline constexpr char kHtmlScript[] = R"html(<script>
'use strict';
const kMostShown = 1000;
const number = text => { const n = parseFloat(text.replace(/[^0-9.eE+-]/g, ' ')); return isNaN(n) ? null : n; };
function compare(a, b) {
  if (a === null || b === null) return (a === null) - (b === null);
  return typeof a === 'number' && typeof b === 'number' ? a - b : String(a).localeCompare(String(b));
}
for (const table of document.querySelectorAll('table.sortable')) {
  table.querySelectorAll('th').forEach((head, column) => head.addEventListener('click', () => {
    const body = table.tBodies[0], up = head.dataset.up !== '1';
    head.dataset.up = up ? '1' : '0';
    const value = row => { const text = row.cells[column].textContent; return number(text) ?? (/\w/.test(text) ? text : null); };
    [...body.rows].sort((a, b) => (up ? 1 : -1) * compare(value(a), value(b))).forEach(row => body.append(row));
  }));
}
let order = 0, upwards = true;
const filters = names.slice(0, filterColumns).map((_, column) => {
  const select = document.createElement('select');
  select.append(new Option('all: ' + names[column], ''));
  [...new Set(rows.map(row => row[column]))].forEach(name => select.append(new Option(name, name)));
  select.addEventListener('change', show);
  document.getElementById('filters').append(select);
  return select;
});
const head = document.querySelector('#all thead').insertRow();
names.forEach((name, column) => {
  const cell = document.createElement('th');
  cell.textContent = name.replaceAll('_', ' ');
  cell.addEventListener('click', () => { upwards = order === column ? !upwards : true; order = column; show(); });
  head.append(cell);
});
function show() {
  const found = rows.filter(row => filters.every((select, i) => !select.value || row[i] === select.value));
  found.sort((a, b) => (upwards ? 1 : -1) * compare(a[order], b[order]));
  const body = document.querySelector('#all tbody');
  body.replaceChildren(...found.slice(0, kMostShown).map(row => {
    const line = document.createElement('tr');
    row.forEach(value => { line.insertCell().textContent = value === null ? '\u2013' : value; });
    return line;
  }));
  document.getElementById('count').textContent = found.length + ' rows' + (found.length > kMostShown ? ', the first ' + kMostShown + ' shown' : '');
}
show();
</script></body></html>
)html";

}  // namespace forcegrid::evaluation
