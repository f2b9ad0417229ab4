// SPDX-License-Identifier: Apache-2.0
// The camera turns around a target, with z up. It can follow a moving point.

import * as THREE from '/three.module.js';

const kTurn_rad_per_px = 0.006;
const kSteepest_rad = 1.54;
const kWheelGrowth = 0.0012;

export class Orbit {
  /** @param changed called whenever the picture has to be drawn again. */
  constructor(camera, changed) {
    this.camera = camera;
    this.changed = changed;
    this.target = new THREE.Vector3();
    this.distance_m = 0.4;
    this.azimuth_rad = 0.45;  // 0: from the operator's place, +x
    this.elevation_rad = 0.5;
    this.nearest_m = 0.01;
    this.farthest_m = 10;
    this.apply();
  }

  apply() {
    const level = Math.cos(this.elevation_rad) * this.distance_m;
    this.camera.position.set(this.target.x + level * Math.cos(this.azimuth_rad),
                             this.target.y + level * Math.sin(this.azimuth_rad),
                             this.target.z + Math.sin(this.elevation_rad) * this.distance_m);
    this.camera.near = this.distance_m / 50;
    this.camera.far = this.distance_m * 50;
    this.camera.up.set(0, 0, 1);
    this.camera.lookAt(this.target);
    this.camera.updateMatrixWorld();
    this.camera.updateProjectionMatrix();
    this.changed();
  }

  turn(right_px, down_px) {
    this.azimuth_rad -= right_px * kTurn_rad_per_px;
    this.elevation_rad = Math.max(-kSteepest_rad, Math.min(kSteepest_rad,
        this.elevation_rad + down_px * kTurn_rad_per_px));
    this.apply();
  }

  /** Moves the target in the plane of the picture. */
  pan(right_px, down_px, height_px) {
    const metres = 2 * Math.tan(this.camera.fov * Math.PI / 360) * this.distance_m / height_px;
    const right = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0);
    const up = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 1);
    this.target.addScaledVector(right, -right_px * metres).addScaledVector(up, down_px * metres);
    this.apply();
  }

  zoom(factor) {
    this.distance_m = Math.max(this.nearest_m, Math.min(this.farthest_m, this.distance_m * factor));
    this.apply();
  }

  wheel(delta_px) {
    this.zoom(Math.exp(Math.max(-200, Math.min(200, delta_px)) * kWheelGrowth));
  }

  /** Puts a sphere (centre and radius [m] in W) into the picture. */
  fit(centre, radius_m) {
    const half = Math.min(
        this.camera.fov * Math.PI / 360,
        Math.atan(Math.tan(this.camera.fov * Math.PI / 360) * this.camera.aspect));
    this.target.copy(centre);
    this.distance_m = radius_m / Math.sin(half);
    this.nearest_m = radius_m / 20;
    this.farthest_m = radius_m * 40;
    this.apply();
  }

  /** Moves the target some of the way to a point; share is 0 to 1. */
  approach(point, share) {
    if (this.target.distanceTo(point) > this.distance_m * 1e-4) {
      this.target.lerp(point, share);
      this.apply();
    }
  }
}
