// A model in three dimensions: bones, wrapping surfaces, muscles, a moment arm.
import {
  AmbientLight,
  Box3,
  BufferAttribute,
  BufferGeometry,
  Color,
  DirectionalLight,
  Group,
  Line,
  LineBasicMaterial,
  LineDashedMaterial,
  PerspectiveCamera,
  Scene,
  Sphere,
  Spherical,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { bodies, matrix, mesh, meshes, plainBone, surface } from "./shapes.js";
import { Tube } from "./tube.js";

/** How near a pointer is to a path that it means [px]. */
const NEAR = 10;
/** Turn of an arrow key [rad], and what a key for distance multiplies it with. */
const [TURN, ZOOM] = [Math.PI / 36, 1.12];
/** Radius of the strongest muscle, relative to the size of the model. */
const THICKEST = 0.015;
const DIM = 0.18;

export class View3d {
  /**
   * - `holder`: element that it fills; `description`: of the model; `geometry`: bytes of bone geometry, empty for none
   * - `posture`: the first one, decoded
   */
  constructor({ holder, description, geometry, posture, label }) {
    Object.assign(this, { holder, description });
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    holder.prepend(this.canvas);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(32, 1, 0.001, 50);
    this.scene.add(new AmbientLight(0xffffff, 1.5), this.camera);
    const [key, fill] = [new DirectionalLight(0xffffff, 1.9), new DirectionalLight(0xffffff, 0.5)];
    key.position.set(-0.6, 1, 0.9);
    fill.position.set(1, -0.4, 0.4);
    this.camera.add(key, fill);
    this.build(geometry ? meshes(geometry) : null, posture);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.enableDamping = false;
    this.controls.addEventListener("change", () => this.draw());
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.canvas.addEventListener("pointermove", (event) => this.onHover?.(this.at(event), event));
    this.canvas.addEventListener("pointerleave", () => this.onHover?.(null));
    let pressed = null;
    this.canvas.addEventListener("pointerdown", ({ clientX, clientY }) => {
      pressed = [clientX, clientY];
    });
    this.canvas.addEventListener("click", (event) => {
      // The end of a turn is no choice.
      if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      const muscle = this.at(event);
      if (muscle !== null) this.onSelect?.(muscle);
    });
    new ResizeObserver(() => this.resize()).observe(holder);
    this.show(posture);
    this.resize();
    this.home();
  }

  build(found, posture) {
    const { bodies: names, bones, wraps, muscles } = this.description;
    this.bodies = bodies(names.length);
    this.scene.add(...this.bodies);
    this.bones = bodies(names.length);
    this.bodies.forEach((body, i) => body.add(this.bones[i]));
    const withMesh = new Set();
    for (const shown of found?.shown ?? []) {
      withMesh.add(shown.base);
      this.bones[shown.base].add(mesh(shown, found));
    }
    for (const bone of bones) if (!withMesh.has(bone.base)) this.bones[bone.base].add(plainBone(bone));
    this.surfaces = wraps.map((wrap) => {
      const made = surface(wrap);
      made.visible = false;
      this.bodies[wrap.base].add(made);
      return made;
    });
    this.place(posture);
    this.size = this.extent(posture);
    const strongest = Math.max(...muscles.map((m) => m.max_isometric_force), 1e-9);
    this.tubes = muscles.map((muscle) => {
      const thickness = 0.3 + 0.7 * Math.sqrt(Math.max(muscle.max_isometric_force, 0) / strongest);
      const tube = new Tube(THICKEST * this.size.radius * thickness);
      this.scene.add(tube.mesh);
      return tube;
    });
    this.lines = new Group();
    this.scene.add(this.lines);
  }

  /** The sphere round all muscles and the bones that they are on. */
  extent({ paths }) {
    const box = new Box3();
    const point = new Vector3();
    for (const { points } of paths)
      for (let i = 0; i < points.length; i += 3) {
        if (points.subarray(i, i + 3).every(Number.isFinite)) box.expandByPoint(point.fromArray(points, i));
      }
    this.scene.updateMatrixWorld(true);
    // Geometry of a whole body would leave an arm's muscles small.
    const bones = new Box3();
    for (const group of this.bones) bones.expandByObject(group);
    if (box.isEmpty()) box.copy(bones);
    else {
      const wide = box.clone().expandByScalar(0.45 * box.getSize(point).length());
      box.union(bones.intersect(wide));
    }
    if (box.isEmpty()) box.setFromCenterAndSize(new Vector3(), new Vector3(1, 1, 1));
    this.box = box;
    return box.getBoundingSphere(new Sphere());
  }

  /** Points that are in view once the camera is: of muscles, and the corners of bones within the box round them. */
  outline() {
    const found = [];
    for (const { points } of this.posture.paths)
      for (let i = 0; i < points.length; i += 3) found.push(new Vector3().fromArray(points, i));
    for (const group of this.bones) {
      for (const bone of group.children) {
        const box = new Box3().setFromObject(bone).intersect(this.box);
        if (box.isEmpty()) continue;
        const { min, max } = box;
        for (let k = 0; k < 8; k += 1)
          found.push(new Vector3(k & 1 ? min.x : max.x, k & 2 ? min.y : max.y, k & 4 ? min.z : max.z));
      }
    }
    return found.filter((p) => Number.isFinite(p.x + p.y + p.z));
  }

  place({ poses }) {
    this.bodies.forEach((body, i) => {
      body.matrix.copy(matrix(poses[i]));
      body.matrixWorldNeedsUpdate = true;
    });
  }

  /** Draws a posture. */
  show(posture) {
    this.posture = posture;
    this.place(posture);
    posture.paths.forEach(({ points }, m) => this.tubes[m].draw(points, this.scales?.[m] ?? 1));
    this.draw();
  }

  /**
   * Colours of muscles, as CSS writes them.
   *
   * - `lit`: set of muscles that stand out; empty: all alike. `hidden`, `thin`: sets of muscles that are not drawn, or thin
   */
  paint(colors, lit = new Set(), hidden = new Set(), thin = new Set()) {
    this.scales = this.tubes.map((_, m) => (lit.has(m) ? 1.35 : thin.has(m) ? 0.45 : 1));
    this.tubes.forEach((tube, m) => {
      const isDim = lit.size > 0 && !lit.has(m);
      tube.material.color.set(colors[m]);
      tube.material.emissive.set(lit.has(m) ? colors[m] : "#000000").multiplyScalar(0.25);
      tube.material.opacity = isDim ? DIM : 1;
      tube.material.depthWrite = !isDim;
      // What stands out is seen through bones.
      tube.material.depthTest = !lit.has(m);
      tube.mesh.renderOrder = lit.has(m) ? 1 : 0;
      if (tube.material.transparent !== isDim) {
        tube.material.transparent = isDim;
        tube.material.needsUpdate = true;
      }
      tube.mesh.visible = !hidden.has(m);
      if (this.posture) tube.draw(this.posture.paths[m].points, this.scales[m]);
    });
    this.draw();
  }

  /** - `wraps`: set of wrapping surfaces that are drawn */
  choose({ bones, wraps }) {
    this.bones.forEach((group) => {
      group.visible = bones;
    });
    this.surfaces.forEach((made, w) => {
      made.visible = wraps.has(w);
    });
    this.draw();
  }

  /** Draws moment arms: [{ lever, color }], each of fifteen numbers as the program gives them. */
  levers(all) {
    this.lines.clear();
    for (const { lever, color } of all) {
      const [axis, onAxis, onLine, from, to] = [0, 3, 6, 9, 12].map((i) => new Vector3().fromArray(lever, i));
      const reach = 0.35 * this.size.radius;
      const ends = [onAxis.clone().addScaledVector(axis, -reach), onAxis.clone().addScaledVector(axis, reach)];
      const nearer = from.distanceTo(onLine) < to.distanceTo(onLine) ? from : to;
      this.line(ends, color, true);
      this.line([onAxis, onLine], color, false);
      this.line([nearer, onLine], color, true);
    }
    this.draw();
  }

  line(points, color, dashed) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(points.flatMap((p) => p.toArray())), 3));
    const step = 0.02 * this.size.radius;
    const looks = dashed
      ? new LineDashedMaterial({ color: new Color(color), dashSize: step, gapSize: step, depthTest: false })
      : new LineBasicMaterial({ color: new Color(color), depthTest: false });
    const made = new Line(geometry, looks);
    made.renderOrder = 2;
    made.computeLineDistances();
    this.lines.add(made);
  }

  /** The camera as at the start: all of the model in view, from the front and the side. */
  home(direction = [1, 0.45, 1.1]) {
    const towards = new Vector3(...direction).normalize();
    const right = new Vector3(0, 1, 0).cross(towards).normalize();
    const up = towards.clone().cross(right);
    const points = this.outline();
    if (!points.length) points.push(this.size.center.clone());
    const along = (axis) => points.map((p) => p.dot(axis));
    const [x, y, z] = [right, up, towards].map(along);
    const middle = (v) => (Math.min(...v) + Math.max(...v)) / 2;
    const [mx, my, mz] = [x, y, z].map(middle);
    const slope = Math.tan((0.5 * this.camera.fov * Math.PI) / 180);
    const wide = slope * (this.camera.aspect || 1);
    // Every point is within the picture, with a margin.
    const needed = points.map((_, i) => z[i] - mz + 1.06 * Math.max(Math.abs(x[i] - mx) / wide, Math.abs(y[i] - my) / slope));
    const distance = Math.max(Math.max(...needed), 0.2 * this.size.radius);
    this.controls.target.set(0, 0, 0).addScaledVector(right, mx).addScaledVector(up, my).addScaledVector(towards, mz);
    this.camera.position.copy(this.controls.target).addScaledVector(towards, distance);
    this.camera.near = 0.01 * distance;
    this.camera.far = 20 * distance + 4 * this.size.radius;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }

  key(event) {
    const [turn, up] =
      { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN] }[event.key] ?? [];
    const zoom = { "+": 1 / ZOOM, "=": 1 / ZOOM, "-": ZOOM }[event.key];
    if (event.key === "Home") this.home();
    else if (turn !== undefined || zoom) {
      const offset = this.camera.position.clone().sub(this.controls.target);
      const at = new Spherical().setFromVector3(offset);
      at.theta += turn ?? 0;
      at.phi = Math.min(Math.max(at.phi + (up ?? 0), 0.05), Math.PI - 0.05);
      at.radius *= zoom ?? 1;
      this.camera.position.copy(this.controls.target).add(offset.setFromSpherical(at));
      this.controls.update();
      this.draw();
    } else return;
    event.preventDefault();
  }

  /** Where a point in ground is on the holder [px]. */
  on(point) {
    const p = new Vector3(...point).project(this.camera);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [((p.x + 1) / 2) * width, ((1 - p.y) / 2) * height, p.z];
  }

  /** The muscle whose path is nearest to the pointer; null where none is near. */
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let [best, found] = [NEAR, null];
    this.posture.paths.forEach(({ points }, m) => {
      if (!this.tubes[m].mesh.visible) return;
      let before = null;
      for (let i = 0; i < points.length; i += 3) {
        const now = this.on(points.subarray(i, i + 3));
        if (before && now[2] < 1) {
          const away = distance([x, y], before, now);
          if (away < best) [best, found] = [away, m];
        }
        before = now;
      }
    });
    return found;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.holder;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.render();
  }

  draw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => this.render());
  }

  render() {
    this.asked = false;
    this.renderer.render(this.scene, this.camera);
    this.onDrawn?.();
  }

  /** The picture as PNG, over a ground of this colour. */
  async picture(ground) {
    this.render();
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [this.canvas.width, this.canvas.height];
    const context = copy.getContext("2d");
    context.fillStyle = ground;
    context.fillRect(0, 0, copy.width, copy.height);
    context.drawImage(this.canvas, 0, 0);
    return new Promise((resolve) => copy.toBlob(resolve, "image/png"));
  }
}

/** Distance of a point from a line between two others. */
function distance([x, y], [ax, ay], [bx, by]) {
  const [dx, dy] = [bx - ax, by - ay];
  const along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1);
  const part = Math.min(Math.max(along, 0), 1);
  return Math.hypot(x - ax - part * dx, y - ay - part * dy);
}
