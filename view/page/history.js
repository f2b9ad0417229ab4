// SPDX-License-Identifier: Apache-2.0
// The scope's rows of the last two minutes, in a ring of fixed size.

const kRows = 12000;  // of 10 ms

export class History {
  constructor() {
    this.reset([]);
  }

  /** Forgets all rows; `names` are those of the columns, as the hello message has them. */
  reset(names) {
    this.names = names;
    this.column = Object.fromEntries(names.map((name, index) => [name, index]));
    this.values = new Float32Array(kRows * names.length);
    this.time_s = new Float64Array(kRows);
    this.first = 0;  // number of the oldest row that is kept
    this.end = 0;    // number of rows that came
  }

  get newest_s() {
    return this.end > this.first ? this.time_s[(this.end - 1) % kRows] : 0;
  }

  get oldest_s() {
    return this.end > this.first ? this.time_s[this.first % kRows] : 0;
  }

  get rows() {
    return this.end - this.first;
  }

  /** Adds the rows of a scope message. Rows that begin before the newest start a new history. */
  append(message) {
    const width = this.names.length;
    if (width === 0 || message.columns !== width) {
      return false;
    }
    for (let row = 0; row < message.rows; ++row) {
      const from = row * width;
      const time_s = message.base_s + message.values[from];
      if (this.end > this.first && time_s < this.newest_s - 1) {
        this.first = this.end;
      }
      const slot = this.end % kRows;
      this.values.set(message.values.subarray(from, from + width), slot * width);
      this.time_s[slot] = time_s;
      this.end += 1;
      this.first = Math.max(this.first, this.end - kRows);
    }
    return true;
  }

  /** A value of row `number` (from `first` to `end`), NaN for a column that does not exist. */
  value(number, name) {
    const column = this.column[name];
    return column === undefined ? NaN
                                : this.values[(number % kRows) * this.names.length + column];
  }

  newest(name) {
    return this.end > this.first ? this.value(this.end - 1, name) : NaN;
  }

  time(number) {
    return this.time_s[number % kRows];
  }

  /** The first row at or after a time [s], by bisection. */
  row_at(time_s) {
    let low = this.first;
    let high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) < time_s) {
        low = middle + 1;
      } else {
        high = middle;
      }
    }
    return low;
  }

  /** All columns of the rows of a time span [s] as CSV, with a line of names. */
  csv(from_s, to_s) {
    const lines = [this.names.join(',')];
    for (let row = this.row_at(from_s); row < this.end && this.time(row) <= to_s; ++row) {
      const start = (row % kRows) * this.names.length;
      const cells = Array.from(
          this.values.subarray(start, start + this.names.length),
          (value) => Number.isNaN(value) ? '' : String(Number(value.toPrecision(7))));
      cells[this.column.time_s] = this.time(row).toFixed(4);
      lines.push(cells.join(','));
    }
    return lines.join('\n') + '\n';
  }
}
