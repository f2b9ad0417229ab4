// SPDX-License-Identifier: Apache-2.0
// The range of a colour or an arrow: it grows at once, and shrinks after some seconds.

const kHold_ms = 4000;
const kWide = 0.4;  // share of the range below which it is too wide

/** A round number with at most two digits that is at least `value`, which is positive. */
function round_up(value) {
  const decade = 10 ** Math.floor(Math.log10(value));
  const round = [1, 1.5, 2, 3, 5, 7.5, 10].find((digit) => digit * decade >= value * 0.999);
  return Number((round * decade).toPrecision(2));
}

export class Scale {
  /** @param smallest the range is never smaller. */
  constructor(smallest) {
    this.smallest = smallest;
    this.full = smallest;
    this.largest_lately = 0;
    this.fitted_ms = 0;
  }

  /** Takes a value at a time [ms] and returns the range. */
  update(value, now_ms) {
    this.largest_lately = Math.max(this.largest_lately, value);
    if (value > kWide * this.full) {
      this.fitted_ms = now_ms;
      this.largest_lately = 0;
    }
    if (value > this.full) {
      this.full = round_up(value);
    } else if (now_ms - this.fitted_ms > kHold_ms) {
      this.full = round_up(Math.max(this.largest_lately, this.smallest));
      this.fitted_ms = now_ms;
      this.largest_lately = 0;
    }
    return this.full;
  }
}
