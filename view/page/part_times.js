// SPDX-License-Identifier: Apache-2.0
// How long each part of the page's work takes, of the newest times that it was done.

const kKept = 2000;

export class PartTimes {
  constructor() {
    this.clear();
  }

  clear() {
    this.parts = new Map();
  }

  /** Does some work, as a part with this name. Returns what it returns. */
  measure(name, work) {
    const begin_ms = performance.now();
    const result = work();
    this.add(name, performance.now() - begin_ms);
    return result;
  }

  add(name, time_ms) {
    if (!this.parts.has(name)) {
      this.parts.set(name, {times: 0, kept_ms: new Float32Array(kKept)});
    }
    const part = this.parts.get(name);
    part.kept_ms[part.times % kKept] = time_ms;
    part.times += 1;
  }

  /** By name: how often it was done, and mean, median, 99th percentile and longest [ms]. */
  get summary() {
    return Object.fromEntries([...this.parts].map(([name, {times, kept_ms}]) => {
      const sorted = kept_ms.slice(0, Math.min(times, kKept)).sort();
      const at = (share) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
      return [name, {times, mean_ms: sorted.reduce((sum, ms) => sum + ms, 0) / sorted.length,
                     p50_ms: at(0.5), p99_ms: at(0.99), most_ms: at(1)}];
    }));
  }
}
