// SPDX-License-Identifier: Apache-2.0
// One chart of the scope: a title, a legend with values, curves over time.

/* global Dygraph */

const kMostPoints = 420;
const kBand_px = 14;
const kLabelFont = '10px system-ui, sans-serif';

// The legend is the panel's own; dygraphs' sets style attributes, which the page's policy forbids.
Dygraph.PLUGINS = Dygraph.PLUGINS.filter((plugin) => plugin !== Dygraph.Plugins.Legend);

/** Ticks of a logarithmic axis: powers of ten. */
function decades(low, high) {
  const ticks = [];
  for (let power = Math.ceil(Math.log10(low)); power <= Math.log10(high); ++power) {
    ticks.push({v: 10 ** power, label: String(10 ** power)});
  }
  return ticks;
}

/** One value of a series from a row's start in the history's array. */
function value_of(series, values, start) {
  const [a, b, c] = series.at;
  if (series.kind === 'norm') {
    return Math.sqrt(values[start + a] ** 2 + values[start + b] ** 2 + values[start + c] ** 2);
  }
  const value = values[start + a] * (series.factor || 1);
  return series.positive && !(value > 0) ? NaN : value;
}

/** Lengths of time in which a column keeps its value: {value, from_s, to_s}, in order. */
function spells(history, name, from_s, to_s) {
  const found = [];
  const end = Math.min(history.end, history.row_at(to_s) + 1);
  for (let row = history.row_at(from_s); row < end; ++row) {
    const value = history.value(row, name);
    const last = found[found.length - 1];
    if (last && last.value === value) {
      last.to_s = history.time(row);
    } else {
      if (last) {
        last.to_s = history.time(row);
      }
      found.push({value, from_s: history.time(row), to_s: history.time(row)});
    }
  }
  return found;
}

export class Panel {
  /**
   * @param spec {key, title, unit, series: [{label, colour, kind, columns, arrow}], log, zero,
   *     band,
   *        deadline_us, components}; columns are names of the history's columns.
   * @param scope the Scope that owns this panel.
   */
  constructor(spec, scope) {
    this.spec = spec;
    this.scope = scope;
    this.hidden = new Set();
    this.graph = null;
    this.build();
  }

  build() {
    const {spec} = this;
    this.root = document.createElement('figure');
    this.root.className = 'panel';
    this.root.dataset.panel = spec.key;
    this.root.setAttribute('aria-label', `${spec.title} over time, ${spec.unit}`);
    const head = document.createElement('figcaption');
    const title = document.createElement('span');
    title.className = 'panel-title';
    title.textContent = spec.title;
    const unit = document.createElement('span');
    unit.className = 'unit';
    unit.textContent = spec.unit;
    head.append(title, unit);
    if (spec.components) {
      head.append(this.component_choice());
    }
    this.legend = document.createElement('span');
    this.legend.className = 'legend';
    head.append(this.legend);
    this.chart = document.createElement('div');
    this.chart.className = 'chart';
    this.cursor = document.createElement('div');
    this.cursor.className = 'cursor';
    this.cursor.hidden = true;
    const frame = document.createElement('div');
    frame.className = 'chart-frame';
    frame.append(this.chart, this.cursor);
    this.root.append(head, frame);
    if (spec.band) {
      this.speaker = document.createElement('p');
      this.speaker.className = 'speaker';
      this.root.append(this.speaker);
    }
    this.build_legend();
    this.listen(frame);
  }

  component_choice() {
    const choice = document.createElement('select');
    choice.setAttribute('aria-label', `${this.spec.title}: component`);
    for (const [value, text] of [['norm', 'norm'], ['0', 'x'], ['1', 'y'], ['2', 'z']]) {
      choice.add(new Option(text, value));
    }
    choice.addEventListener('change', () => {
      this.spec.series.forEach((series) => {
        series.kind = choice.value === 'norm' ? 'norm' : 'plain';
        series.columns = choice.value === 'norm' ? series.all : [series.all[Number(choice.value)]];
      });
      this.destroy();
      this.scope.redraw();
    });
    return choice;
  }

  build_legend() {
    this.values = this.spec.series.map((series, i) => {
      const button = document.createElement('button');
      button.type = 'button';
      button.className = 'series';
      button.dataset.colour = series.colour;
      button.setAttribute('aria-pressed', 'true');
      button.title = `${series.label}${series.role ? ', ' + series.role : ''}: show or hide`;
      const name = document.createElement('span');
      name.className = 'series-name';
      name.textContent = series.label;
      const value = document.createElement('output');
      value.className = 'series-value';
      value.setAttribute('aria-live', 'off');
      value.setAttribute('aria-label', `${series.label}, ${this.spec.unit}`);
      button.append(name, value);
      button.addEventListener('click', () => this.toggle(i, button));
      this.legend.append(button);
      return value;
    });
  }

  toggle(i, button) {
    const shown = this.hidden.has(i);
    this.hidden[shown ? 'delete' : 'add'](i);
    button.setAttribute('aria-pressed', String(shown));
    if (this.graph) {
      this.graph.setVisibility(i, shown);
    }
    const {arrow} = this.spec.series[i];
    if (arrow !== undefined) {
      this.scope.on_arrow(arrow, shown);
    }
  }

  listen(frame) {
    frame.addEventListener('pointermove', (event) => {
      this.scope.set_cursor(event.clientX - frame.getBoundingClientRect().left);
    });
    frame.addEventListener('pointerleave', () => this.scope.set_cursor(null));
    frame.addEventListener('pointerdown', () => this.scope.hold(true));
  }

  /** Rows for the chart: all of them, or the least and the greatest of each few. */
  rows(from_s, to_s) {
    const {history} = this.scope;
    const width = history.names.length;
    const series = this.spec.series;
    series.forEach((one) => { one.at = one.columns.map((name) => history.column[name]); });
    const first = Math.max(history.first, history.row_at(from_s) - 1);
    const end = Math.min(history.end, history.row_at(to_s) + 2);
    const together = Math.max(1, Math.ceil(2 * (end - first) / kMostPoints));
    const slots = history.time_s.length;
    const rows = [];
    if (together < 3) {
      for (let row = first; row < end; ++row) {
        const start = (row % slots) * width;
        rows.push(
            [history.time(row), ...series.map((one) => value_of(one, history.values, start))]);
      }
      return rows;
    }
    // Groups begin at multiples of their size, so that a curve does not flicker as it moves.
    for (let group = first - first % together; group < end; group += together) {
      const from = Math.max(group, first);
      const to = Math.min(group + together, end);
      const least = [history.time(from)];
      const most = [history.time((from + to - 1) >> 1)];
      for (const one of series) {
        let low = NaN;
        let high = NaN;
        for (let row = from; row < to; ++row) {
          const value = value_of(one, history.values, (row % slots) * width);
          low = value < low || low !== low ? value : low;
          high = value > high || high !== high ? value : high;
        }
        const rises = rows.length === 0 || !(rows[rows.length - 1][least.length] > high);
        least.push(rises ? low : high);
        most.push(rises ? high : low);
      }
      rows.push(least, most);
    }
    return rows;
  }

  draw(from_s, to_s) {
    const file = this.rows(from_s, to_s);
    if (file.length < 2 || this.chart.clientWidth < 40 || this.chart.clientHeight < 30) {
      return;
    }
    if (!this.graph) {
      this.create(file, [from_s, to_s]);
    } else {
      this.graph.updateOptions({file, dateWindow: [from_s, to_s]});
    }
    this.show_values();
    this.place_cursor();
  }

  create(file, window_s) {
    const {spec} = this;
    const palette = this.scope.palette;
    const axis = {axisLabelFontSize: 10, drawGrid: true};
    this.graph = new Dygraph(this.chart, file, {
      labels: ['time [s]', ...spec.series.map((_, i) => String(i))],  // two may have the same name
      colors: spec.series.map((series) => palette.of(series.colour)),
      visibility: spec.series.map((_, i) => !this.hidden.has(i)),
      legend: 'never',
      dateWindow: window_s,
      strokeWidth: 1.3,
      highlightCircleSize: 0,
      series: spec.series[0].colour === 'commanded' ? {0: {strokeWidth: 2.6}} : {},
      logscale: Boolean(spec.log),
      includeZero: Boolean(spec.zero) && !spec.log,
      gridLineColor: palette.grid,
      axisLineColor: palette.grid,
      rightGap: 8,
      yRangePad: spec.band ? kBand_px + 3 : 5,
      axes: {
        x: {
          ...axis,
          axisLabelFormatter: (s) => `${Number(s.toFixed(2))}`,
          pixelsPerLabel: 55,
          axisLabelWidth: 46
        },
        y: {...axis, axisLabelWidth: 38, pixelsPerLabel: 24, ...(spec.log ? {ticker: decades} : {})}
      },
      xAxisHeight: 17,
      interactionModel: {...Dygraph.defaultInteractionModel, dblclick: () => this.scope.follow()},
      underlayCallback: (context, area, graph) => this.underlay(context, area, graph),
      drawCallback: (graph) => this.scope.on_range(this, graph.xAxisRange()),
    });
  }

  /** Behind the curves: times of contact, the deadline, the candidate that speaks. */
  underlay(context, area, graph) {
    const {history, palette, hello} = this.scope;
    const [from_s, to_s] = graph.xAxisRange();
    context.save();
    context.beginPath();
    context.rect(area.x, area.y, area.w, area.h);
    context.clip();
    context.fillStyle = palette.contact;
    for (const spell of spells(history, 'in_contact', from_s, to_s)) {
      if (spell.value > 0) {
        const left = graph.toDomXCoord(spell.from_s);
        context.fillRect(left, area.y, graph.toDomXCoord(spell.to_s) - left, area.h);
      }
    }
    if (this.spec.deadline_us) {
      this.draw_deadline(context, area, graph);
    }
    if (this.spec.band) {
      for (const spell of spells(history, 'candidate', from_s, to_s)) {
        this.draw_spell(context, area, graph, spell, hello.candidates || []);
      }
    }
    context.restore();
  }

  draw_deadline(context, area, graph) {
    const y = Math.round(graph.toDomYCoord(this.spec.deadline_us)) + 0.5;
    const text = 'period wanted';
    context.strokeStyle = context.fillStyle = this.scope.palette.deadline;
    context.setLineDash([5, 4]);
    context.beginPath();
    context.moveTo(area.x, y);
    context.lineTo(area.x + area.w, y);
    context.stroke();
    context.font = kLabelFont;
    context.fillText(text, area.x + 5, y + 12);
  }

  draw_spell(context, area, graph, spell, candidates) {
    const {palette} = this.scope;
    const left = graph.toDomXCoord(spell.from_s);
    const width = graph.toDomXCoord(spell.to_s) - left;
    const name = candidates[spell.value];
    if (name === undefined) {
      return;
    }
    context.fillStyle = palette.candidate(spell.value);
    context.fillRect(left, area.y + area.h - kBand_px, width, kBand_px);
    const start = Math.max(left, area.x) + 4;
    context.font = kLabelFont;
    if (context.measureText(name).width + 8 < left + width - start) {
      context.fillStyle = palette.on_candidate;
      context.fillText(name, start, area.y + area.h - 4);
    }
  }

  /** Values under the cursor, or the newest. */
  show_values() {
    const {history, cursor_s, hello} = this.scope;
    if (history.rows === 0) {
      return;
    }
    const row = cursor_s === null ? history.end - 1
                                  : Math.min(history.end - 1, history.row_at(cursor_s));
    const start = (row % history.time_s.length) * history.names.length;
    this.spec.series.forEach((series, i) => {
      series.at = series.columns.map((name) => history.column[name]);
      const value = value_of(series, history.values, start);
      this.values[i].textContent = Number.isFinite(value) ? value.toFixed(this.spec.digits) : '–';
    });
    if (this.spec.band) {
      const candidate = (hello.candidates || [])[history.value(row, 'candidate')];
      const reason = (hello.reasons || [])[history.value(row, 'reason')];
      this.speaker.textContent =
          candidate ? `${candidate} speaks${reason ? `: ${reason}` : ''}` : '';
    }
  }

  place_cursor() {
    const {cursor_px} = this.scope;
    const area = this.graph ? this.graph.getArea() : null;
    this.cursor.hidden = !area || cursor_px === null || cursor_px < area.x ||
                         cursor_px > area.x + area.w;
    if (!this.cursor.hidden) {
      this.cursor.style.left = `${cursor_px}px`;
    }
  }

  destroy() {
    if (this.graph) {
      this.graph.destroy();
      this.graph = null;
    }
  }
}
