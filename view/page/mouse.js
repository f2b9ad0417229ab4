// SPDX-License-Identifier: Apache-2.0
// Pointer and arrow keys on the 3-D picture: turns, moves and zooms it, or drags the emulated hand
// by its tool.

const kGrab_px = 22;
const kHandInterval_ms = 1000 / 60;
const kKeyTurn_px = 24;
const kKeyZoom = 1.12;

export class Mouse {
  /**
   * @param send_hand(target) sends a target [m in W] as [x, y, z], or null: let go.
   */
  constructor(scene, send_hand) {
    this.scene = scene;
    this.send_hand = send_hand;
    this.hand_allowed = false;
    this.pointers = new Map();
    this.dragging = null;  // id of the pointer that drags the tool
    this.last_sent_ms = -Infinity;
    this.later = 0;
    const {canvas} = scene;
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      canvas.addEventListener(name, (event) => this.up(event));
    }
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      scene.orbit.wheel(event.deltaY);
    }, {passive: false});
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    addEventListener('blur', () => this.let_go());
    document.addEventListener('visibilitychange', () => this.let_go());
  }

  /** Arrows turn the picture, plus and minus zoom it, while it has the focus. */
  key(event) {
    const {orbit} = this.scene;
    const action = {
      ArrowLeft: () => orbit.turn(kKeyTurn_px, 0), ArrowRight: () => orbit.turn(-kKeyTurn_px, 0),
      ArrowUp: () => orbit.turn(0, kKeyTurn_px), ArrowDown: () => orbit.turn(0, -kKeyTurn_px),
      '+': () => orbit.zoom(1 / kKeyZoom), '-': () => orbit.zoom(kKeyZoom),
    }[event.key];
    if (action && !event.ctrlKey && !event.altKey && !event.metaKey) {
      event.preventDefault();
      action();
    }
  }

  set_hand_allowed(allowed) {
    this.hand_allowed = allowed;
    if (!allowed) {
      this.let_go();
    }
  }

  /** Is the pointer where the tool is, or was a moment ago? A moving tool is hard to hit. */
  over_tool(event) {
    return this.hand_allowed && this.scene.has_tool && this.scene.trail.some((place) => {
      const at = this.scene.project(place);
      return Math.hypot(at.x - event.clientX, at.y - event.clientY) < kGrab_px;
    });
  }

  down(event) {
    this.scene.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (event.button === 0 && !event.shiftKey && this.pointers.size === 1 &&
        this.over_tool(event)) {
      this.dragging = event.pointerId;
      this.scene.drag_origin = this.scene.tool_at.clone();
      this.aim(event);
    }
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (this.dragging === event.pointerId) {
      this.aim(event);
    } else if (before) {
      this.move_camera(event, before);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    }
    this.scene.canvas.dataset.cursor =
        this.dragging !== null ? 'dragging' : this.over_tool(event) ? 'tool' : 'turn';
  }

  move_camera(event, [x, y]) {
    const {orbit, canvas} = this.scene;
    if (this.pointers.size > 1) {
      const [other] =
          [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const before = Math.hypot(x - other[0], y - other[1]);
      const after = Math.hypot(event.clientX - other[0], event.clientY - other[1]);
      orbit.zoom(before / Math.max(after, 1));
    } else if (event.shiftKey || (event.buttons & 6) !== 0) {
      orbit.pan(event.clientX - x, event.clientY - y, canvas.clientHeight);
    } else {
      orbit.turn(event.clientX - x, event.clientY - y);
    }
  }

  /** Moves the target under the pointer; sends it now, or when 1/60 s has passed. */
  aim(event) {
    const target = this.scene.point_in_tool_plane(event.clientX, event.clientY);
    if (!target) {
      return;
    }
    this.scene.set_target(target);
    clearTimeout(this.later);
    const wait_ms = this.last_sent_ms + kHandInterval_ms - performance.now();
    if (wait_ms <= 0) {
      this.send_target();
    } else {
      this.later = setTimeout(() => this.send_target(), wait_ms);
    }
  }

  send_target() {
    if (this.scene.target_at) {
      this.last_sent_ms = performance.now();
      this.send_hand(this.scene.target_at.toArray());
    }
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    if (this.dragging === event.pointerId) {
      this.let_go();
    }
  }

  let_go() {
    if (this.dragging === null) {
      return;
    }
    clearTimeout(this.later);
    this.dragging = null;
    this.scene.drag_origin = null;
    this.scene.set_target(null);
    this.send_hand(null);
  }
}
