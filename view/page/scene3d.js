// SPDX-License-Identifier: Apache-2.0
// The 3-D picture. It is drawn only when something in it changed, in fewer pixels where drawing is
// slow.

import * as THREE from '/three.module.js';
import {Blocks} from '/blocks.js';
import {Insides} from '/inside.js';
import {Orbit} from '/orbit.js';
import {Field} from '/field.js';
import {OtherTools} from '/other_tools.js';
import {Arm, Arrow, ContactPoint, Samples, Tool, Wall, workspace_lines} from '/parts.js';
import {Scale} from '/scale.js';
import {Surface} from '/surface.js';

const kMethods = 4;
const kFieldOfView_deg = 32;
const kTrail = 12;
const kLongestArrow = 0.95;  // of the object's radius
const kSlow_ms = 36;      // until the browser is ready again: more, and the next have fewer pixels
const kFast_ms = 24;      // less, and the next have more
const kLowestScale = 0.6;
const kLate_ms = 80;      // one of those that are judged took more: pictures come late
const kJudged = 12;       // intervals that are judged together
const kNotAgain_ms = 15000;  // after a time that was too slow
const kSoftwareInterval_ms = 24;
const kSoftwareScale = 0.75;  // to begin with
const kFadeInterval_ms = 60;

/** Does the browser draw by software? Then antialiasing costs more than it gives. */
function draws_by_software() {
  const gl = document.createElement('canvas').getContext('webgl2');
  const details = gl && gl.getExtension('WEBGL_debug_renderer_info');
  const name = details ? gl.getParameter(details.UNMASKED_RENDERER_WEBGL) : '';
  const lose = gl && gl.getExtension('WEBGL_lose_context');
  if (lose) {
    lose.loseContext();
  }
  return /swiftshader|llvmpipe|softpipe|software/i.test(name);
}

export class Scene3d {
  /** Without WebGL 2 nothing is drawn, and `renderer` is null: stop and scope work all the same. */
  constructor(canvas) {
    this.canvas = canvas;
    this.software = draws_by_software();
    const context = canvas.getContext('webgl2', {antialias: !this.software, alpha: false});
    this.renderer = context ? new THREE.WebGLRenderer({canvas, context}) : null;
    this.largest_scale = Math.min(this.software ? 1 : 2, devicePixelRatio);
    this.scale = this.software ? kSoftwareScale : this.largest_scale;
    this.scale_is_fixed = false;
    this.sharper_at_ms = 0;
    this.drawn_ms = -Infinity;
    this.intervals = [];
    this.late = false;
    this.dirty = true;
    this.camera = new THREE.PerspectiveCamera(kFieldOfView_deg, 1, 0.01, 10);
    this.scene = new THREE.Scene();
    this.orbit = new Orbit(this.camera, () => { this.dirty = true; });
    this.surfaces = new Map();
    this.shown = {surface: true, mesh: false, arm: true, samples: true, forces: true,
                  workspace: true};
    this.hidden_arrows = new Set();
    this.colouring = 'displacement';
    this.tool_at = new THREE.Vector3();
    this.trail = [];  // places of the tool in the newest pictures
    this.target_at = null;
    this.drag_origin = null;  // where the tool was when a drag began
    this.has_tool = false;
    this.live = false;  // otherwise the forces are old, and are not drawn
    this.in_contact = false;
    this.follows = false;
    this.was_fitted = false;
    this.radius_m = 0.1;
    this.force_scale = new Scale(0.1);
    this.box = null;
    this.palette = null;
    this.make_parts();
  }

  make_parts() {
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x606870, 0.75));
    const key = new THREE.DirectionalLight(0xffffff, 0.55);
    key.position.set(0.4, -0.5, 1);
    this.scene.add(key);
    this.surface_group = new THREE.Group();
    this.mesh_group = new THREE.Group();
    this.arm = new Arm();
    this.samples = new Samples();
    this.recorded_s = null;
    this.tool = new Tool();
    this.others = new OtherTools();
    this.field = new Field();
    this.blocks = new Blocks();
    this.insides = new Insides();
    this.contact_point = new ContactPoint();
    this.wall = new Wall();
    this.wall_m = null;
    this.arrows = Array.from({length: kMethods + 1}, (_, i) => new Arrow(10 + i));
    this.arrow_group = new THREE.Group();
    this.arrow_group.add(...this.arrows.map((arrow) => arrow.group));
    this.forces = this.arrows.map(() => [NaN, NaN, NaN]);
    this.workspace = new THREE.Group();
    this.scene.add(this.surface_group, this.mesh_group, this.arm.group, this.samples.points,
                   this.tool.group, this.arrow_group, this.workspace, this.field.mesh,
                   this.field.directions.lines, this.blocks.lines, this.insides.group,
                   this.contact_point.cross, this.wall.group, this.others.group);
  }

  /** Takes the workspace and the largest force of a hello message. */
  set_run(hello) {
    const limit_N = hello.largest_force_N > 0 ? hello.largest_force_N : 5;
    this.force_scale = new Scale(limit_N / 50);
    this.workspace.remove(...this.workspace.children);
    this.box = null;
    if (hello.workspace_W_m) {
      const {low, high} = hello.workspace_W_m;
      this.box = new THREE.Box3(new THREE.Vector3(...low), new THREE.Vector3(...high));
      this.workspace.add(...workspace_lines(low, high).children);
    }
    this.apply_theme();
    if (!this.was_fitted) {
      this.fit();
    }
  }

  set_shape(shape) {
    this.remove_surface(shape.object);
    const surface = new Surface(shape, this.insides.section);
    surface.set_colouring(this.colouring);
    this.surfaces.set(shape.object, surface);
    this.surface_group.add(surface.mesh);
    if (this.shown.mesh) {
      this.mesh_group.add(surface.edge_lines());
    }
    this.apply_theme();
    if (!this.was_fitted) {
      this.fit();
    }
    this.dirty = true;
  }

  set_live(live) {
    this.live = live;
    this.dirty = true;
  }

  /** Forgets the surfaces: a new connection sends them again. */
  clear_surfaces() {
    [...this.surfaces.keys()].forEach((object) => this.remove_surface(object));
  }

  remove_surface(object) {
    const surface = this.surfaces.get(object);
    if (surface) {
      this.surfaces.delete(object);
      this.surface_group.remove(surface.mesh);
      this.mesh_group.remove(...(surface.lines ? [surface.lines] : []));
      surface.dispose();
      this.insides.remove(object);  // it is another one, too
      this.dirty = true;
    }
  }

  /** Shows a surface frame; false if there is no shape for it. */
  set_frame(frame, now_ms) {
    const surface = this.surfaces.get(frame.object);
    const taken = surface !== undefined && surface.update(frame, now_ms);
    this.dirty = this.dirty || taken;
    return taken;
  }

  lose_surface(object) {
    const surface = this.surfaces.get(object);
    if (surface) {
      surface.dim();
      this.insides.remove(object);
      this.dirty = true;
    }
  }

  /** Opens the objects at a plane, so that what is inside is seen, or closes them. */
  show_inside(shown) {
    const {section} = this.insides;
    if (shown !== section.active) {
      section.active = shown;
      this.surfaces.forEach((surface) => surface.apply_section());
      this.dirty = true;
    }
    if (!shown) {
      this.insides.clear();
    }
  }

  set_inside_lines(message) {
    this.insides.set_lines(message);
    this.dirty = true;
  }

  set_inside_frame(frame) {
    this.dirty = this.insides.set_frame(frame) || this.dirty;
  }

  /** @param forces_W_N commanded force first, then each method's own; NaN is not drawn. */
  set_tool(position_W_m, forces_W_N, in_contact, now_ms) {
    this.tool_at.set(...position_W_m);
    this.trail.push(position_W_m);
    this.trail.splice(0, this.trail.length - kTrail);
    this.forces = forces_W_N;
    this.force_scale.update(Math.max(0, ...forces_W_N.map((force) => Math.hypot(...force))
        .filter(Number.isFinite)), now_ms);
    this.in_contact = in_contact;
    this.has_tool = position_W_m.every(Number.isFinite);
    this.dirty = true;
  }

  /** The hand's target, or null. */
  set_target(position_W_m) {
    this.target_at = position_W_m;
    this.dirty = true;
  }

  set_arm(message) {
    this.arm.update(message.lines, this.radius_m * 0.022);
    this.dirty = true;
  }

  set_other_arm(message) {
    this.others.set_arm(message, this.radius_m);
    this.dirty = true;
  }

  set_other_tool(message) {
    this.others.set_place(message);
    this.dirty = true;
  }

  /** @param tools a Set of the places of those that are there. */
  keep_other_tools(tools) {
    this.others.keep(tools);
    this.dirty = true;
  }

  /** Shows a slice of the field; null hides it. */
  set_field(message) {
    if (message) {
      this.field.show(message);
    } else {
      this.field.hide();
    }
    this.dirty = true;
  }

  /** Shows blocks of storage; null hides them. */
  set_blocks(message) {
    this.blocks.show(message);
    this.dirty = true;
  }

  set_field_quantity(quantity) {
    this.field.set_quantity(quantity);
    this.dirty = true;
  }

  /** A wall at this height in W [m], or null. */
  set_wall(height_m) {
    if (height_m !== this.wall_m) {
      this.wall_m = height_m;
      this.dirty = true;
    }
  }

  /** What the surfaces' colours stand for: 'displacement' or 'strain'. */
  set_colouring(colouring) {
    this.colouring = colouring;
    this.surfaces.forEach((surface) => surface.set_colouring(colouring));
    this.dirty = true;
  }

  add_samples(message, now_ms) {
    this.samples.add(message, this.sample_time_s(now_ms), this.recorded_s !== null);
    this.dirty = true;
  }

  /** By what clock samples fade: the page's, or that of a recording. */
  sample_time_s(now_ms) {
    return this.recorded_s === null ? now_ms / 1000 : this.recorded_s;
  }

  /** The time of the recording that is shown; null: a run is. */
  set_recorded_time(time_s) {
    if (time_s !== this.recorded_s) {
      this.recorded_s = time_s;
      this.dirty = true;
    }
  }

  /** What was shown is not what leads to what comes next. */
  forget_past() {
    this.samples.clear();
    this.trail = [];
    this.dirty = true;
  }

  show_layer(name, shown) {
    this.shown[name] = shown;
    if (name === 'mesh' && shown) {
      this.surfaces.forEach((surface) => this.mesh_group.add(surface.edge_lines()));
    }
    this.dirty = true;
  }

  show_arrow(index, shown) {
    this.hidden_arrows[shown ? 'delete' : 'add'](index);
    this.dirty = true;
  }

  set_theme(palette) {
    this.palette = palette;
    this.apply_theme();
  }

  apply_theme() {
    const palette = this.palette;
    if (!palette) {
      return;
    }
    if (this.renderer) {
      this.renderer.setClearColor(palette.backdrop);
    }
    this.surfaces.forEach((surface) => surface.set_theme(palette));
    this.arm.material.color.set(palette.arm);
    this.field.set_theme(palette);
    this.blocks.set_theme(palette);
    this.insides.set_theme(palette);
    this.tool.set_theme(palette);
    this.others.set_theme(palette);
    this.wall.set_theme(palette);
    this.contact_point.cross.material.color.set(palette.touch);
    this.samples.uniforms.asked_colour.value.set(palette.accent);
    this.samples.uniforms.free_colour.value.set(palette.free_sample);
    this.samples.uniforms.touch_colour.value.set(palette.touch_sample);
    this.arrows.forEach((arrow, i) => arrow.material.color.set(
        i === 0 ? palette.commanded : palette.series[i - 1]));
    this.workspace.children.forEach((lines) => lines.material.color.set(palette.workspace));
    this.dirty = true;
  }

  /** The box of the surfaces, else of the workspace, else around the origin. */
  content_box() {
    const box = new THREE.Box3();
    this.surfaces.forEach((surface) => box.union(surface.box));
    if (box.isEmpty() && this.box) {
      box.copy(this.box);
    }
    if (box.isEmpty()) {
      box.setFromCenterAndSize(new THREE.Vector3(), new THREE.Vector3(0.1, 0.1, 0.1));
    }
    return box;
  }

  /** Puts the object into the picture, with room for the tool and the forces above it. */
  fit() {
    const sphere = this.content_box().getBoundingSphere(new THREE.Sphere());
    this.radius_m = Math.max(sphere.radius, 1e-4);
    this.was_fitted = this.surfaces.size > 0;
    const centre = sphere.center.clone();
    centre.z += 0.12 * this.radius_m;
    this.orbit.fit(centre, this.radius_m * 1.22);
  }

  get tool_radius_m() {
    return this.radius_m * 0.035;
  }

  resize() {
    const {clientWidth, clientHeight} = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) {
      return;
    }
    if (this.renderer) {
      this.renderer.setPixelRatio(this.scale);
      this.renderer.setSize(clientWidth, clientHeight, false);
    }
    this.camera.aspect = clientWidth / clientHeight;
    this.orbit.apply();
    this.dirty = true;
  }

  /** Makes the browser compile the shaders, before the first picture waits for them. */
  warm_up() {
    const plain = new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]);
    this.warm_surface = new Surface({epoch: 0, vertices: 3, triangles: 1, rest_W_m: plain,
                              corners: new Uint32Array([0, 1, 2])}, this.insides.section);
    this.surface_group.add(this.warm_surface.mesh);
    if (this.renderer) {
      this.renderer.compile(this.scene, this.camera);  // also of what is not seen yet
    }
    this.draw(performance.now(), true);
    this.surface_group.remove(this.warm_surface.mesh);  // it is kept, and its shader with it
    this.dirty = true;
  }

  /** Draws at this share of the pixels from now on. */
  fix_scale(scale) {
    this.scale = scale;
    this.scale_is_fixed = true;
    this.resize();
  }

  /** Judges the time between pictures [ms] and changes the number of pixels if it must. */
  judge(interval_ms, now_ms) {
    this.intervals.push(interval_ms);
    if (this.intervals.length < kJudged) {
      return;
    }
    const sorted = this.intervals.sort((a, b) => a - b);
    const median = sorted[kJudged >> 1];
    this.late = median > kSlow_ms || sorted[kJudged - 1] > kLate_ms;
    this.intervals = [];
    if (this.scale_is_fixed) {
      return;
    }
    const before = this.scale;
    if (median > kSlow_ms) {
      this.scale = Math.max(kLowestScale, this.scale * 0.85);
      this.sharper_at_ms = now_ms + kNotAgain_ms;
    } else if (median < kFast_ms && now_ms > this.sharper_at_ms) {
      this.scale = Math.min(this.largest_scale, this.scale * 1.1);
    }
    if (this.scale !== before) {
      this.resize();
    }
  }

  /** May the next picture be drawn? Software draws every other one of 60 a second. */
  due(now_ms) {
    return !this.software || now_ms - this.drawn_ms > kSoftwareInterval_ms;
  }

  /** Draws if something changed. Returns whether it did. */
  draw(now_ms, force = false) {
    const now_s = this.sample_time_s(now_ms);
    if (this.follows && this.has_tool) {
      this.orbit.approach(this.tool_at, 0.15);
    }
    this.dirty = this.dirty || (now_ms - this.drawn_ms > kFadeInterval_ms && this.shown.samples &&
                                this.samples.fading(now_s));
    if (!this.dirty && !force) {
      return false;
    }
    this.dirty = false;
    this.drawn_ms = now_ms;
    this.samples.uniforms.now_s.value = now_s;
    this.samples.uniforms.size_px.value = 7 * this.scale;
    this.surface_group.visible = this.shown.surface;
    this.mesh_group.visible = this.shown.mesh;
    this.arm.group.visible = this.shown.arm;
    this.samples.points.visible = this.shown.samples;
    this.workspace.visible = this.shown.workspace;
    this.arrow_group.visible = this.shown.forces && this.has_tool && this.live;
    this.tool.group.visible = this.has_tool;
    this.place_arrows();
    this.tool.update(this.tool_at, this.target_at, this.in_contact && this.live, this.tool_radius_m,
                     this.camera);
    this.others.update(this.shown, this, this.camera);
    this.contact_point.update(this.live ? this.samples.contact_W_m : null, this.tool_radius_m,
                              this.camera);
    this.wall.place(this.wall_m, 2 * this.radius_m);
    this.camera.updateMatrixWorld();
    this.insides.place(this.camera, this.has_tool ? this.tool_at : null, this.content_box());
    if (this.renderer) {
      this.renderer.render(this.scene, this.camera);
    }
    return true;
  }

  get metres_per_N() {
    return kLongestArrow * this.radius_m / this.force_scale.full;
  }

  place_arrows() {
    const {metres_per_N} = this;
    this.arrows.forEach((arrow, i) => {
      arrow.update(this.tool_at, this.forces[i] || [NaN, NaN, NaN], metres_per_N,
                   this.radius_m * (i === 0 ? 0.018 : 0.0075));
      arrow.group.visible = arrow.group.visible && !this.hidden_arrows.has(i);
    });
  }

  /** Pixel [px from the window's corner] of a point in W [m]; z < 1 is before the far plane. */
  project(position_W_m) {
    const place = this.canvas.getBoundingClientRect();
    const seen = new THREE.Vector3(...position_W_m).project(this.camera);
    return {x: place.left + (seen.x + 1) / 2 * place.width,
            y: place.top + (1 - seen.y) / 2 * place.height, z: seen.z};
  }

  /** The point in W under a pixel, in the plane through the tool that faces the camera. */
  point_in_tool_plane(x_px, y_px) {
    const place = this.canvas.getBoundingClientRect();
    const through = new THREE.Vector3((x_px - place.left) / place.width * 2 - 1,
                                      1 - (y_px - place.top) / place.height * 2, 0.5);
    through.unproject(this.camera);
    const normal = this.camera.getWorldDirection(new THREE.Vector3());
    const ray = new THREE.Ray(this.camera.position.clone(),
                              through.sub(this.camera.position).normalize());
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(
        normal, this.drag_origin || this.tool_at);
    const point = ray.intersectPlane(plane, new THREE.Vector3());
    if (point && this.box) {
      point.clamp(this.box.min, this.box.max);
    }
    return point;
  }
}
