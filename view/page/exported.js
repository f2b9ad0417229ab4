// SPDX-License-Identifier: Apache-2.0
// The recordings of a run that are in the page itself, in place of a connection: it hands out what
// the live view would send, by a clock of its own, and does what the player's bar asks for.

import {kArm, kField, kFrame, kOtherTool, kSamples, kScope, kShape} from '/decode.js';

const kMagic = 'FGX1';
const kRecordHead = 16;       // f64 time, u32 bytes, u32 1 for a text + 256 * the tool's place
const kTick_ms = 16;
const kSay_ms = 100;
const kPast_s = 115;          // of the scope's rows that a place needs
const kSamplePast_s = 20;
const kSliceHead = 44;
const kSliceNumbers = 5;      // of each point: force x, y, z, uncertainty, status
const kNotCompared = 255;
const kPictures = [kShape, kFrame, kArm, kOtherTool];  // of which the newest alone counts

/** The element's base64, without gzip. */
async function unpacked(element) {
  const text = atob(element.textContent.trim());
  const packed = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).arrayBuffer();
}

/** The records in order of time: {time_s, tool, text} or {time_s, tool, kind, object,
 *  bytes: ArrayBuffer}. */
function records_of(buffer) {
  const view = new DataView(buffer);
  const letters = new Uint8Array(buffer);
  if (String.fromCharCode(...letters.subarray(0, 4)) !== kMagic) {
    throw new Error('the recording in this page is damaged');
  }
  const records = [];
  for (let at = 4; at < buffer.byteLength;) {
    const time_s = view.getFloat64(at, true);
    const size = view.getUint32(at + 8, true);
    const is_text = view.getUint8(at + 12) === 1;
    const tool = view.getUint8(at + 13);
    const bytes = buffer.slice(at + kRecordHead, at + kRecordHead + size);
    records.push(is_text ? {time_s, tool, text: JSON.parse(new TextDecoder().decode(bytes))}
                         : {time_s, tool, kind: new Uint8Array(bytes)[0],
                            object: new Uint8Array(bytes)[1], bytes});
    at += kRecordHead + size;
  }
  return records;
}

/** The number of records at or before a time, by bisection. */
function count_until(records, time_s) {
  let low = 0;
  let high = records.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (records[middle].time_s <= time_s) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

/** A slice of one method less another's at the same points. */
function difference(slice, other) {
  const bytes = slice.slice(0);
  const numbers = new Float32Array(bytes, kSliceHead);
  const less = new Float32Array(other, kSliceHead);
  for (let i = 0; i < numbers.length; i += kSliceNumbers) {
    for (let axis = 0; axis < 3; ++axis) {
      numbers[i + axis] -= less[i + axis];
    }
  }
  new Uint8Array(bytes)[2] = new Uint8Array(other)[1];
  return bytes;
}

export class ExportedRecording {
  /** @param handlers as Connection's. @param element holds the recording. */
  constructor(handlers, element) {
    this.handlers = handlers;
    this.element = element;
    this.open = false;
    this.playing = true;
    this.speed = 1;
    this.held_s = 0;            // time of the recording ...
    this.held_ms = 0;           // ... at this time of the page
    this.given_s = -Infinity;   // up to where it was handed out
    this.wish = null;           // for a slice of the field
    this.slice = null;          // that was handed out last
    this.said_ms = -Infinity;
    this.next_id = 1;
  }

  async connect() {
    try {
      this.records = records_of(await unpacked(this.element));
    } catch (error) {
      this.handlers.on_open();
      this.handlers.on_text({type: 'note', level: 'error', component: 'page',
                             text: String(error.message || error)});
      return;
    }
    this.pictures = this.records.filter(({kind}) => kPictures.includes(kind));
    this.hellos = new Map(this.records.filter(({text}) => text && text.type === 'hello')
                              .map(({tool, text}) => [tool, text]));
    this.open = true;
    this.handlers.on_open();
    this.show_tool(Math.min(...this.hellos.keys()));
    if (this.hellos.size > 1) {
      const tools = [...this.hellos].sort(([a], [b]) => a - b)
                        .map(([tool, {device}]) => ({tool, device, live: true}));
      this.handlers.on_text({type: 'tools', tools});
    }
    this.hold(0);
    this.go_to(0);
    setInterval(() => this.tick(), kTick_ms);
  }

  /** Begins with a tool: scope, samples and field are its own, pictures of all. */
  show_tool(tool) {
    const of = (kind) =>
        this.records.filter((record) => record.kind === kind && record.tool === tool);
    this.tool = tool;
    this.rows = of(kScope);
    this.samples = of(kSamples);
    this.slices = of(kField);
    this.wish = this.slice = null;
    this.given_s = -Infinity;
    const hello = this.hellos.get(tool);
    this.duration_s = hello.recording.duration_s;
    this.handlers.on_text({...hello, blocks: false, role: 'controller'});
    this.records.filter(({text, tool: its_tool}) => text && text.type === 'note' &&
                                    (its_tool === tool || text.component === 'export'))
        .forEach(({text}) => this.handlers.on_text(text));
  }

  choose(tool) {
    if (this.hellos.has(tool) && tool !== this.tool) {
      const time_s = this.now_s;
      this.show_tool(tool);
      this.go_to(time_s);
    }
  }

  slow_down() {}

  get now_s() {
    const since_s = (performance.now() - this.held_ms) / 1000;
    return Math.min(this.duration_s, this.held_s + (this.playing ? this.speed * since_s : 0));
  }

  hold(time_s) {
    this.held_s = time_s;
    this.held_ms = performance.now();
  }

  send(what, fields = {}) {
    const action = {
      play: () => this.play(fields), seek: () => this.go_to(fields.time_s),
      field: () => this.want(fields), tool: () => this.choose(fields.tool),
    }[what];
    if (!action || !this.open) {
      return null;
    }
    // The page has sent it first and is told the answer then, as by a connection.
    setTimeout(action, 0);
    return this.next_id++;
  }

  play({value, speed}) {
    const time_s = this.now_s;
    this.hold(value && time_s >= this.duration_s ? 0 : time_s);
    this.playing = value;
    this.speed = speed;
    this.go_to(this.held_s);
  }

  go_to(time_s) {
    this.hold(Math.min(this.duration_s, Math.max(0, time_s)));
    if (this.held_s < this.given_s) {
      this.given_s = -Infinity;
      this.slice = null;
    }
    this.say({state: 'seeking', ...(this.given_s === -Infinity ? {anew: {}} : {})});
    this.give(this.held_s);
    this.say();
  }

  tick() {
    if (!this.playing) {
      return;
    }
    const now_s = this.now_s;
    this.give(now_s);
    if (now_s >= this.duration_s) {
      this.hold(now_s);
      this.playing = false;
      this.say();
    } else if (performance.now() - this.said_ms >= kSay_ms) {
      this.say();
    }
  }

  say(fields = {}) {
    this.said_ms = performance.now();
    this.handlers.on_text({type: 'playback', state: this.playing ? 'playing' : 'paused',
                           time_s: this.now_s, speed: this.speed, ...fields});
  }

  /** Hands out what leads from where it was to a time: of pictures the newest alone. */
  give(time_s) {
    const hand_out = (record) => this.handlers.on_binary(record.bytes.slice(0), performance.now());
    const between = (records, past_s) => records.slice(
        count_until(records, Math.max(this.given_s, time_s - past_s)),
        count_until(records, time_s));
    between(this.rows, kPast_s).forEach(hand_out);
    between(this.samples, kSamplePast_s).forEach(hand_out);
    const newest = new Map();
    between(this.pictures, Infinity).forEach((record) => {
      newest.set(`${record.object} ${record.kind}`, record);
    });
    [...newest.values()].sort((a, b) => a.kind - b.kind).forEach(hand_out);
    this.given_s = time_s;
    this.give_slice();
  }

  want({method, compared, normal}) {
    this.wish = method === null || method === undefined
        ? null : {method, compared: compared ?? kNotCompared, normal};
    this.slice = null;
    this.give_slice();
  }

  /** The newest slice of a method and axis. */
  newest_slice(method, normal) {
    for (let i = count_until(this.slices, this.given_s) - 1; i >= 0; --i) {
      const [, its_method, , its_normal] = new Uint8Array(this.slices[i].bytes, 0, 4);
      if (its_method === method && its_normal === normal) {
        return this.slices[i].bytes;
      }
    }
    return null;
  }

  give_slice() {
    if (!this.wish) {
      return;
    }
    const {method, compared, normal} = this.wish;
    const slice = this.newest_slice(method, normal);
    const other = compared === kNotCompared ? slice : this.newest_slice(compared, normal);
    if (!slice || !other || slice === this.slice) {
      return;
    }
    this.slice = slice;
    this.handlers.on_binary(other === slice && compared === kNotCompared
                                ? slice.slice(0) : difference(slice, other), performance.now());
  }
}
