// SPDX-License-Identifier: Apache-2.0
// Wires the page: what comes from the live view goes to the picture and the scope; what the person
// does goes back.

import {Connection} from '/connection.js';
import {Pause, Rendered, Stop, listen_to_keys} from '/controls.js';
import {decode, kArm, kBlocks, kField, kFrame, kInsideFrame, kInsideLines, kOtherTool, kSamples,
        kScope, kShape} from '/decode.js';
import {save_csv, save_png} from '/export.js';
import {ExportedRecording} from '/exported.js';
import {FieldChoice} from '/field_choice.js';
import {History} from '/history.js';
import {Layers} from '/layers.js';
import {Mouse} from '/mouse.js';
import {PartTimes} from '/part_times.js';
import {Playback} from '/playback.js';
import {Readouts, is_paused} from '/readouts.js';
import {when_resized} from '/resized.js';
import {Scene3d} from '/scene3d.js';
import {Scope} from '/scope.js';
import {Settings} from '/settings.js';
import {palette, start_theme} from '/theme.js';
import {ToolChoice} from '/tool_choice.js';
import {Tour} from '/tour.js';

const kScopeInterval_ms = 40;        // one panel each time
const kSoftwareScopeInterval_ms = 80;  // a panel costs software as much as a third of a picture
const kLateScopeInterval_ms = 160;     // while pictures come late
const kReadoutInterval_ms = 100;
const kShownInterval_ms = 50;
const kWaitForSurface_ms = 1500;     // then a run without a surface is live, too
const kMethods = 4;
const kMostWaitingSamples = 64;      // messages
const kRecording = 'this is a recording: there is no force to stop or to pause';

const by_id = (id) => document.getElementById(id);

class Page {
  constructor() {
    this.readouts = new Readouts();
    this.history = new History();
    this.hello = {};
    this.role = '';
    this.lacks_past = false;  // of a recording
    this.state = 'connecting';
    this.counted = {frames: 0, pictures: 0, broken: 0};
    this.rates = {frames: 0, pictures: 0, since_ms: performance.now(), frames_per_s: 0, fps: 0};
    this.delays_ms = [];
    this.times = new PartTimes();
    this.waiting_frames = new Map();
    this.waiting_insides = new Map();
    this.waiting_samples = [];
    this.waiting_arms = new Map();
    this.waiting_tools = new Map();
    this.new_rows = false;
    this.last = {scope_ms: 0, readout_ms: 0, shown_ms: 0, cycle: -1, tick_ms: 0, drew: false};
    this.scene = new Scene3d(by_id('scene'));
    const handlers = {
      on_open: () => this.on_open(),
      on_text: (message) => this.on_text(message),
      on_binary: (buffer, arrived_ms) => this.on_binary(buffer, arrived_ms),
      on_lost: () => this.on_lost(),
    };
    const exported = by_id('exported');
    this.connection = exported ? new ExportedRecording(handlers, exported)
                               : new Connection(handlers);
    this.scope = new Scope(this.history, {panels: by_id('panels'), chips: by_id('panel-chips'),
                                          window_s: by_id('window-s'), freeze: by_id('freeze')},
                           (arrow, shown) => this.scene.show_arrow(arrow, shown));
    this.mouse = new Mouse(this.scene, (target_W_m) =>
        this.connection.send('hand', {target_W_m}, target_W_m !== null));
    this.stop = new Stop(this.connection, by_id('stop'), by_id('stop-word'), by_id('stop-status'),
                         () => this.state === 'live');
    this.tool_choice = new ToolChoice(
        this.connection, {label: by_id('tool-choice'), list: by_id('tool')},
        () => this.mouse.let_go());
    this.field = new FieldChoice(this.connection, this.scene);
    this.layers = new Layers(this.connection, this.scene);
    this.rendered = new Rendered(this.connection, by_id('rendered'));
    this.pause = new Pause(this.connection, by_id('pause'));
    this.playback = new Playback(this.connection, () => this.on_anew());
    this.settings = new Settings(this.connection, {menu: by_id('settings'),
        list: by_id('settings-list'), measured: by_id('settings-measured')});
    this.tour = new Tour(this.settings, this.connection, () => this.scene.resize());
    this.listen();
  }

  listen() {
    start_theme(by_id('theme'), (colours) => {
      this.palette = colours;
      this.scene.set_theme(colours);
      this.scope.set_theme(colours);
    });
    const help = by_id('help');
    const show_help = () =>
        (help.open ? help.close() : help.show());  // not modal: stop stays there
    by_id('help-open').addEventListener('click', show_help);
    by_id('help-close').addEventListener('click', () => help.close());
    by_id('fit').addEventListener('click', () => this.scene.fit());
    by_id('follow').addEventListener('click', () => this.toggle_follow());
    by_id('take-control').addEventListener('click', () => this.connection.send('take_control'));
    by_id('csv').addEventListener('click', () => save_csv(this.history, this.scope.frozen_s));
    by_id('png').addEventListener('click', () => save_png(
        document.querySelector('main'), palette(),
        () => this.scene.draw(performance.now(), true)));
    document.querySelectorAll('[data-layer]').forEach((box) => {
      box.addEventListener('change', () => this.scene.show_layer(box.dataset.layer, box.checked));
    });
    by_id('colouring').addEventListener(
        'change', () => this.scene.set_colouring(by_id('colouring').value));
    listen_to_keys(this.stop, {p: () => this.pause.press(), f: () => this.scene.fit(),
                               o: () => this.toggle_follow(), '?': show_help,
                               Escape: () => help.close()});
    when_resized(by_id('scene'), () => {
      this.scene.resize();
      this.scene.draw(performance.now());
    });
  }

  start() {
    this.scene.warm_up();
    this.connection.connect();
    const tick = (now_ms) => {
      requestAnimationFrame(tick);
      this.tick(now_ms);
    };
    requestAnimationFrame(tick);
  }

  toggle_follow() {
    this.scene.follows = !this.scene.follows;
    by_id('follow').setAttribute('aria-pressed', String(this.scene.follows));
    this.scene.dirty = true;
  }

  set_state(state) {
    this.state = state;
    this.scene.set_live(state === 'live');
    this.readouts.set_state(state, this.scene.renderer !== null, this.playback.shown);
  }

  on_open() {
    this.scene.clear_surfaces();
    this.tool_choice.on_open();
    this.wait();
  }

  /** Waits for a run. What the last one ended with stays in sight. */
  wait() {
    if (this.state !== 'ended') {
      this.set_state('waiting');
    }
  }

  on_lost() {
    this.forbid('not connected');
    if (this.state === 'ended') {
      this.connection.slow_down();  // its server probably ended, too
    } else {
      this.set_state('lost');
    }
  }

  /** There is nothing that a person could change. */
  forbid(why) {
    this.mouse.set_hand_allowed(false);
    this.pause.set_allowed(false, why);
    this.rendered.set_allowed(false);
    this.settings.set_allowed(false);
    this.tour.set_allowed(false);
    this.playback.set_allowed(false);
  }

  on_text(message) {
    const handler = {
      hello: () => this.on_hello(message),
      role: () => this.set_role(message.role, message.control_is_free),
      note: () => this.readouts.add_note(message),
      acknowledged: () => this.on_acknowledged(message),
      settings: () => this.settings.on_settings(message),
      end: () => this.on_end(message),
      playback: () => this.on_playback(message),
      tools: () => this.on_tools(message),
      waiting: () => this.wait(),
      surface_lost: () => this.scene.lose_surface(message.object),
    }[message.type];
    if (handler) {
      this.times.measure('text', handler);
    }
  }

  on_tools(message) {
    this.tool_choice.take(message);
    this.scene.keep_other_tools(this.tool_choice.others);
  }

  on_hello(hello) {
    this.hello = hello;
    this.lacks_past = (hello.tool || 0) !== this.tool_choice.shown;
    this.tool_choice.set_run(hello);
    this.scene.keep_other_tools(this.tool_choice.others);
    this.playback.set_run(hello);
    this.scene.set_recorded_time(this.playback.shown ? 0 : null);
    this.history.reset(hello.columns || []);
    this.scene.set_run(hello);
    this.scope.set_run(hello);
    this.readouts.set_run(hello);
    this.readouts.clear_notes();
    this.waiting_frames.clear();
    this.hello_ms = performance.now();
    this.frames_at_hello = this.counted.frames;
    this.last.cycle = -1;
    this.set_state('waiting');
    this.settings.set_run(hello);
    this.tour.set_run(hello);
    this.set_role(hello.role || this.role);
    this.stop.on_run();
    this.field.set_run(hello);
    this.layers.set_run(hello);
    this.rendered.set_run(hello);
    this.rendered.set_allowed(this.role === 'controller');
  }

  /** @param control_is_free false: another page has the control and keeps it. */
  set_role(role, control_is_free) {
    this.role = role;
    const controls = this.hello.controls || [];
    const controller = role === 'controller';
    const why = this.playback.shown ? kRecording
                : controller ? 'this run cannot be paused' : 'another page has the control';
    this.pause.set_allowed(controller && controls.includes('pause'), why);
    this.mouse.set_hand_allowed(controller && controls.includes('hand'));
    this.rendered.set_allowed(controller);
    this.playback.set_allowed(controller);
    this.stop.set_off(this.playback.shown ? kRecording : '', () => this.playback.toggle());
    this.settings.set_allowed(controller);
    this.tour.set_allowed(controller);
    by_id('take-control').hidden = controller || role === '';
    by_id('take-control').disabled = control_is_free === false;
  }

  /** Of a tool that was just chosen, the player is asked for what led to the place. */
  on_playback(message) {
    this.playback.take(message);
    if (this.lacks_past && message.state !== 'seeking') {
      this.lacks_past = false;
      this.playback.go_to(message.time_s);
    }
  }

  /** A recording goes elsewhere: what the page holds does not lead there. */
  on_anew() {
    this.history.reset(this.hello.columns || []);
    this.waiting_samples = [];
    this.scene.forget_past();
  }

  on_acknowledged(message) {
    this.stop.on_acknowledged(message);
    this.pause.on_acknowledged(message);
    this.rendered.on_acknowledged(message);
    this.settings.on_acknowledged(message);
    if (!message.done && message.what !== 'stop') {
      this.readouts.add_note({level: 'warn', component: message.what,
                              text: message.text || 'was refused'});
    }
  }

  on_end(message) {
    this.forbid('the run has ended');
    this.stop.on_end();
    this.set_state('ended');
    const status = message.exit_status === undefined ? '' : ` (exit status ${message.exit_status})`;
    this.readouts.add_note({level: message.exit_status ? 'error' : 'info', component: 'run',
                            text: `ended: ${message.text || message.ended_by}${status}`});
  }

  on_binary(buffer, arrived_ms) {
    const message = decode(buffer);
    if (message === null) {
      this.counted.broken += 1;
    } else if (message.type === kScope) {
      this.new_rows = this.history.append(message) || this.new_rows;
      this.rows_arrived_ms = arrived_ms;
    } else if (message.type === kShape) {
      this.times.measure('shape', () => this.scene.set_shape(message));
      this.waiting_frames.delete(message.object);
      this.waiting_insides.delete(message.object);
    } else if (message.type === kFrame) {
      message.arrived_ms = arrived_ms;
      this.waiting_frames.set(message.object, message);
    } else if (message.type === kSamples) {
      this.waiting_samples.push(message);
      this.waiting_samples.splice(0, this.waiting_samples.length - kMostWaitingSamples);
    } else if (message.type === kArm) {
      this.waiting_arms.set(message.tool, message);
    } else if (message.type === kOtherTool) {
      this.waiting_tools.set(message.tool, message);
    } else if (message.type === kField) {
      this.field.take(message);
    } else if (message.type === kBlocks) {
      this.layers.take_blocks(message);
    } else if (message.type === kInsideLines) {
      this.layers.take_inside_lines(message);
    } else if (message.type === kInsideFrame) {
      this.waiting_insides.set(message.object, message);
    }
  }

  /** Everything that came since the last picture goes into the scene. */
  take_news(now_ms) {
    let arrived_ms = Infinity;
    for (const frame of this.waiting_frames.values()) {
      if (this.times.measure('surface', () => this.scene.set_frame(frame, now_ms))) {
        this.counted.frames += 1;
        arrived_ms = Math.min(arrived_ms, frame.arrived_ms);
      }
    }
    this.waiting_frames.clear();
    this.waiting_insides.forEach((frame) => this.scene.set_inside_frame(frame));
    this.waiting_insides.clear();
    this.waiting_samples.forEach((message) => this.scene.add_samples(message, now_ms));
    this.waiting_samples = [];
    this.take_arms_and_tools();
    if (this.new_rows) {
      const position =
          ['x', 'y', 'z'].map((axis) => this.history.newest(`position_${axis}_mm`) / 1000);
      const force =
          (name) => ['x', 'y', 'z'].map((axis) => this.history.newest(`${name}_${axis}_N`));
      this.scene.set_tool(position, [force('force'), ...Array.from(
          {length: kMethods}, (_, i) => force(`method${i}`))],
                          this.history.newest('in_contact') > 0, now_ms);
      this.rendered.set_now(this.history.newest('rendered_method'));
      this.pause.set_paused(is_paused(this.history, this.hello));
    }
    return arrived_ms;
  }

  /** Those that are not of the shown tool are drawn as long as the live view lists them. */
  take_arms_and_tools() {
    const {shown, others} = this.tool_choice;
    this.waiting_arms.forEach((message, tool) => {
      if (tool === shown) {
        this.scene.set_arm(message);
      } else if (others.has(tool)) {
        this.scene.set_other_arm(message);
      }
    });
    this.waiting_tools.forEach((message, tool) => {
      if (others.has(tool)) {
        this.scene.set_other_tool(message);
      }
    });
    this.waiting_arms.clear();
    this.waiting_tools.clear();
  }

  tick(now_ms) {
    if (this.stop.is_urgent(now_ms)) {
      return;
    }
    this.times.add('between', now_ms - this.last.tick_ms);
    if (this.last.drew) {
      this.scene.judge(now_ms - this.last.tick_ms, now_ms);
    }
    this.last.tick_ms = now_ms;
    this.last.drew = this.scene.due(now_ms) && this.show_news(now_ms);
    if (this.state === 'waiting' && this.hello.columns && this.shows_run(now_ms)) {
      this.set_state('live');
    }
    if (this.is_time_for('scope_ms', this.scope_interval_ms, now_ms)) {
      this.times.measure('scope', () => this.scope.draw_next());
    }
    if (this.is_time_for('readout_ms', kReadoutInterval_ms, now_ms)) {
      this.times.measure('readouts', () => this.show_readouts(now_ms));
    }
  }

  /** Work that goes with a picture, after it: frames in which the picture stays would cost the
   *  browser more. Without a picture it waits a little longer. */
  is_time_for(name, interval_ms, now_ms) {
    const waited_ms = now_ms - this.last[name];
    if (waited_ms < (this.last.drew ? interval_ms : 1.5 * interval_ms)) {
      return false;
    }
    this.last[name] = now_ms;
    return true;
  }

  get scope_interval_ms() {
    return !this.scene.software ? kScopeInterval_ms
           : this.scene.late    ? kLateScopeInterval_ms : kSoftwareScopeInterval_ms;
  }

  /** Draws the picture with everything that came. Returns whether anything was drawn. */
  show_news(now_ms) {
    if (this.playback.seeking) {
      return this.scene.draw(now_ms);
    }
    if (this.playback.shown) {
      this.scene.set_recorded_time(this.playback.now.time_s);
    }
    const had_rows = this.new_rows;
    const arrived_ms = this.take_news(now_ms);
    this.new_rows = false;
    const drew = this.times.measure('scene', () => this.scene.draw(now_ms));
    if (drew) {
      this.counted.pictures += 1;
      this.times.measure(
          'compass', () => this.readouts.draw_compass(this.scene.camera, this.palette));
    }
    if (arrived_ms < Infinity) {
      this.delays_ms.push(performance.now() - arrived_ms);
      this.delays_ms.splice(0, this.delays_ms.length - 60);
    }
    if (had_rows) {
      this.times.add('rows waited', performance.now() - this.rows_arrived_ms);
      this.report_shown(now_ms);
    }
    return drew;
  }

  shows_run(now_ms) {
    return this.counted.frames > this.frames_at_hello ||
           (this.history.rows > 0 && this.scene.surfaces.size === 0 &&
            now_ms - this.hello_ms > kWaitForSurface_ms);
  }

  /** Tells the live view which cycle is in the picture, at most 20 times a second. */
  report_shown(now_ms) {
    const cycle = Math.round(this.history.newest('cycle'));
    if (this.role === 'controller' && cycle !== this.last.cycle && cycle >= 0 &&
        now_ms - this.last.shown_ms >= kShownInterval_ms) {
      this.last.shown_ms = now_ms;
      this.last.cycle = cycle;
      this.connection.send('shown', {cycle}, true);
    }
  }

  show_readouts(now_ms) {
    const {rates, counted} = this;
    const passed_s = (now_ms - rates.since_ms) / 1000;
    if (passed_s >= 1) {
      rates.frames_per_s = (counted.frames - rates.frames) / passed_s;
      rates.fps = (counted.pictures - rates.pictures) / passed_s;
      Object.assign(rates, {frames: counted.frames, pictures: counted.pictures, since_ms: now_ms});
    }
    this.readouts.show_row(this.history, this.hello, this.state === 'live');
    this.readouts.show_scale(this.scene);
    this.settings.show_measured(this.history);
    this.scene.set_wall(this.settings.wall_m);
    if (this.state === 'live') {
      this.tour.on_live();
    }
    const missed = this.history.newest('missed_deadlines');
    this.readouts.show_numbers([
      this.vertices > 0 && `${this.vertices.toLocaleString('en')} vertices`,
      `${rates.frames_per_s.toFixed(0)} surface frames/s`,
      `${rates.fps.toFixed(0)} pictures/s`,
      this.scene.scale < 1 && `scale ${this.scene.scale.toFixed(2)}`,
      Number.isFinite(missed) && `missed deadlines ${missed}`,
      counted.broken > 0 && `broken messages ${counted.broken}`,
      this.role,
    ]);
  }

  get vertices() {
    return [...this.scene.surfaces.values()].reduce(
        (sum, surface) => sum + surface.shape.vertices, 0);
  }
}

function median(values) {
  return values.length ? [...values].sort((a, b) => a - b)[values.length >> 1] : NaN;
}

/** What scripts may ask of the page. */
function interface_for_scripts(page) {
  const newest = (names) => names.map((name) => page.history.newest(name));
  return {
    get frames() { return page.counted.frames; },
    get pictures() { return page.counted.pictures; },
    get vertices() { return page.vertices; },
    get stop_acknowledged() { return page.stop.acknowledged; },
    get fps() { return page.rates.fps; },
    get render_scale() { return page.scene.scale; },
    get software() { return page.scene.software; },
    get role() { return page.role; },
    /** The player of a recording: {state, time_s, speed}; null: a run is shown. */
    get playback() { return page.playback.shown ? page.playback.now : null; },
    get time_s() { return page.history.newest_s; },
    get rows() { return page.history.rows; },
    get position_mm() { return newest(['position_x_mm', 'position_y_mm', 'position_z_mm']); },
    get force_N() { return newest(['force_x_N', 'force_y_N', 'force_z_N']); },
    /** Shares of the slice's points that are known, partly known and unknown; is it exact? */
    get field() {
      const {mesh, top_N, message} = page.scene.field;
      return {shown: mesh.visible, top_N, exact: message !== null && message.exact,
              ...page.scene.field.shares()};
    },
    /** The strokes that show where the slice's forces point: both ends of each in W [m]. */
    get directions() {
      const {lines, strokes} = page.scene.field.directions;
      return lines.visible ? strokes : [];
    },
    /** The method's number of each block of storage that is drawn; how many are in use. */
    get blocks() {
      const {methods, in_use, lines} = page.scene.blocks;
      return {drawn: lines.visible ? [...methods] : [], in_use};
    },
    /** What is inside the objects: how much they have, how much is known and is drawn near the
     *  section, the sum of the lengths. */
    get inside() {
      const {insides} = page.scene;
      return {springs: insides.sum('springs'), element_edges: insides.sum('element_edges'),
              edges: insides.sum('edges'), drawn: insides.sum('drawn'), frames: insides.sum('frames'),
              length_m: insides.sum('length_m'), opened: insides.section.active};
    },
    inside_vertex: (object, vertex) =>
        page.scene.insides.objects.get(object).position_W_m(vertex),
    get rendered_method() { return page.history.newest('rendered_method'); },
    /** How the run says that a setting stands; what the servo measures; answered commands. */
    setting: (name) => page.settings.value(name),
    set: (name, value) => page.settings.send(name, value),
    get measured() { return page.settings.measured(page.history); },
    get settings_answered() {
      return {acknowledged: page.settings.acknowledged, refused: page.settings.refused};
    },
    get contact() {
      const {contact_W_m, epoch, requested} = page.scene.samples;
      return {point_W_m: contact_W_m, epoch, requested};
    },
    get wall_m() { return page.scene.wall.group.visible ? page.scene.wall_m : null; },
    get tour_step() { return page.tour.current ? page.tour.current.key : null; },
    get tour_visited() { return page.tour.visited; },
    get tour_ready() { return page.tour.ready; },
    get in_contact() { return page.history.newest('in_contact') > 0; },
    /** The place of the tool that is shown, and where the others are. */
    get tool() { return page.tool_choice.shown; },
    get other_tools() {
      return [...page.scene.others.parts].map(([tool, {at_W_m, force_W_N, in_contact, arm}]) => (
          {tool, position_W_m: at_W_m, force_W_N, in_contact,
           links: arm.links.filter((link) => link.visible).length}));
    },
    /** How long the parts of the page's work take; clear_times() begins anew. */
    get times() { return page.times.summary; },
    clear_times: () => page.times.clear(),
    get broken_messages() { return page.counted.broken; },
    /** Milliseconds from a surface frame's arrival to its picture, and the cycle reported last. */
    get latency() {
      return {arrival_to_drawn_ms: median(page.delays_ms), shown_cycle: page.last.cycle};
    },
    /** View and projection, by columns, and the picture's place in the window [px]. */
    get camera() {
      const place = page.scene.canvas.getBoundingClientRect();
      return {view: [...page.scene.camera.matrixWorldInverse.elements],
              projection: [...page.scene.camera.projectionMatrix.elements],
              left: place.left, top: place.top, width: place.width, height: place.height};
    },
    /** Draws at this share of the pixels from now on, however slow that is. */
    fix_scale: (scale) => page.scene.fix_scale(scale),
    project: (position_W_m) => page.scene.project(position_W_m),
  };
}

const page = new Page();
window.forcegridView = interface_for_scripts(page);
page.start();
