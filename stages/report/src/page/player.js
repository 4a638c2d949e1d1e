"use strict";
/* Reads a binary glTF file as this project writes it, says where its nodes are at a time, and draws them with
 * WebGL 2: no normals, no textures, no skins. Poses are column-major 4 by 4 matrices. */

const Pose = {
  identity: () => new Float64Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
  times(a, b) {
    const c = new Float64Array(16);
    for (let column = 0; column < 4; column++)
      for (let row = 0; row < 4; row++)
        for (let k = 0; k < 4; k++) c[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    return c;
  },
  of(t, [x, y, z, w], s) {
    return new Float64Array([
      s[0] * (1 - 2 * (y * y + z * z)), s[0] * 2 * (x * y + z * w), s[0] * 2 * (x * z - y * w), 0,
      s[1] * 2 * (x * y - z * w), s[1] * (1 - 2 * (x * x + z * z)), s[1] * 2 * (y * z + x * w), 0,
      s[2] * 2 * (x * z + y * w), s[2] * 2 * (y * z - x * w), s[2] * (1 - 2 * (x * x + y * y)), 0,
      t[0], t[1], t[2], 1]);
  },
  lookAt(eye, target, up) {
    const minus = (a, b) => a.map((x, i) => x - b[i]);
    const unit = (a) => { const n = Math.hypot(...a); return a.map((x) => x / n); };
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const z = unit(minus(eye, target)), x = unit(cross(up, z)), y = cross(z, x);
    return new Float64Array([x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
      -dot(x, eye), -dot(y, eye), -dot(z, eye), 1]);
  },
  perspective(fov, aspect, near, far) {
    const f = 1 / Math.tan(fov / 2);
    return new Float64Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1,
      0, 0, 2 * far * near / (near - far), 0]);
  },
};

/* A file. */
class Glb {
  constructor(buffer) {
    const view = new DataView(buffer);
    if (view.getUint32(0, true) !== 0x46546c67 || view.getUint32(8, true) !== buffer.byteLength)
      throw new Error("not a binary glTF file");
    const jsonLength = view.getUint32(12, true);
    this.json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, jsonLength)));
    this.start = 28 + jsonLength;
    this.buffer = buffer;
    const nodes = this.json.nodes;
    this.parents = nodes.map(() => -1);
    nodes.forEach((node, idx) => (node.children || []).forEach((child) => { this.parents[child] = idx; }));
    this.channels = [];
    this.duration = 0;
    for (const animation of this.json.animations || [])
      for (const { sampler, target } of animation.channels) {
        const { input, output, interpolation } = animation.samplers[sampler];
        const times = this.accessor(input);
        this.duration = Math.max(this.duration, times[times.length - 1]);
        this.channels.push({ node: target.node, path: target.path, step: interpolation === "STEP", times,
          values: this.accessor(output) });
      }
  }

  /* The numbers of an accessor, those of 16 bits between -1 and 1. */
  accessor(idx) {
    const { bufferView, componentType, count, type, normalized } = this.json.accessors[idx];
    const offset = this.start + (this.json.bufferViews[bufferView].byteOffset || 0);
    const n = count * { SCALAR: 1, VEC3: 3, VEC4: 4 }[type];
    const kind = { 5126: Float32Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array }[componentType];
    const numbers = new kind(this.buffer.slice(offset, offset + n * kind.BYTES_PER_ELEMENT));
    return normalized ? Float32Array.from(numbers, (x) => Math.max(x / 32767, -1)) : numbers;
  }

  static valueAt({ path, step, times, values }, time) {
    const width = path === "rotation" ? 4 : 3;
    let low = 0, high = times.length;
    while (low < high) { const middle = (low + high) >> 1; if (times[middle] <= time) low = middle + 1; else high = middle; }
    const from = Math.max(low - 1, 0), at = (key) => Array.from(values.subarray(width * key, width * key + width));
    const a = at(from);
    const unit = (q) => { const n = Math.hypot(...q); return q.map((x) => x / n); };
    if (low === 0 || low === times.length || step) return width === 4 ? unit(a) : a;
    const share = (time - times[from]) / (times[low] - times[from]);
    let b = at(low);
    if (width === 3) return a.map((x, i) => x + share * (b[i] - x));
    const p = unit(a);
    b = unit(b);
    let cosine = p.reduce((sum, x, i) => sum + x * b[i], 0);
    if (cosine < 0) { b = b.map((x) => -x); cosine = -cosine; }
    if (cosine > 1 - 1e-10) return p;
    const angle = Math.acos(cosine), s = Math.sin(angle);
    return p.map((x, i) => (Math.sin((1 - share) * angle) * x + Math.sin(share * angle) * b[i]) / s);
  }

  /* The pose of every node in the scene at a time, y up. */
  poses(time) {
    const nodes = this.json.nodes.map((node) => ({ translation: node.translation || [0, 0, 0],
      rotation: node.rotation || [0, 0, 0, 1], scale: node.scale || [1, 1, 1] }));
    for (const channel of this.channels) nodes[channel.node][channel.path] = Glb.valueAt(channel, time);
    const poses = new Array(nodes.length);
    const pose = (idx) => {
      if (!poses[idx]) {
        const own = Pose.of(nodes[idx].translation, nodes[idx].rotation, nodes[idx].scale);
        poses[idx] = this.parents[idx] < 0 ? own : Pose.times(pose(this.parents[idx]), own);
      }
      return poses[idx];
    };
    nodes.forEach((_, idx) => pose(idx));
    return poses;
  }

  /* The position of a node in the table's frame, z up, in meters, and its axes as columns. */
  tableFrom(name, time) {
    const idx = this.json.nodes.findIndex((node) => node.name === name);
    if (idx < 0) return null;
    const p = this.poses(time)[idx];
    const up = (x, y, z) => [x, -z, y];
    return { position: up(p[12], p[13], p[14]), x: up(p[0], p[1], p[2]), y: up(p[4], p[5], p[6]), z: up(p[8], p[9], p[10]) };
  }
}

const VERTEX = `#version 300 es
uniform mat4 clipFromWorld, worldFromMesh;
in vec3 position;
out vec3 world;
void main() { vec4 p = worldFromMesh * vec4(position, 1.0); world = p.xyz; gl_Position = clipFromWorld * p; }`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 color;
uniform vec3 eye;
uniform int table;
in vec3 world;
out vec4 shown;
void main() {
  vec3 normal = normalize(cross(dFdx(world), dFdy(world)));
  vec3 toEye = normalize(eye - world);
  if (dot(normal, toEye) < 0.0) normal = -normal;
  float sun = max(dot(normal, normalize(vec3(0.4, 1.0, 0.55))), 0.0);
  float light = 0.36 + 0.16 * normal.y + 0.55 * sun + 0.12 * max(dot(normal, toEye), 0.0);
  vec3 paint = color.rgb;
  if (table == 1 && normal.y > 0.5) {
    vec2 line = abs(fract(world.xz / 0.05 - 0.5) - 0.5) / fwidth(world.xz / 0.05);
    paint = mix(paint * 0.72, paint, clamp(min(line.x, line.y), 0.0, 1.0));
  }
  shown = vec4(pow(clamp(paint * light, 0.0, 1.0), vec3(1.0 / 2.2)), color.a);
}`;

/* A view of a file on a canvas. */
class Player {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: false, preserveDrawingBuffer: true });
    this.camera = { turn: 0.9, rise: 0.45, distance: 0.62, target: [0, 0.1, 0] };
    this.hidden = { ghost: false, contact: false };
    this.follow = true;
    this.glb = null;
    this.time = 0;
    if (!this.gl) return;
    const gl = this.gl;
    const shader = (kind, text) => {
      const one = gl.createShader(kind);
      gl.shaderSource(one, text);
      gl.compileShader(one);
      return one;
    };
    this.program = gl.createProgram();
    gl.attachShader(this.program, shader(gl.VERTEX_SHADER, VERTEX));
    gl.attachShader(this.program, shader(gl.FRAGMENT_SHADER, FRAGMENT));
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(this.program));
    this.at = {};
    for (const name of ["clipFromWorld", "worldFromMesh", "color", "eye", "table"])
      this.at[name] = gl.getUniformLocation(this.program, name);
    this.position = gl.getAttribLocation(this.program, "position");
  }

  show(glb) {
    this.glb = glb;
    this.time = 0;
    // So far away that hand and object are in view at the start.
    const [a, b] = this.ends(glb.poses(0));
    this.camera.distance = Math.min(Math.max(0.42 + 1.1 * Math.hypot(...[12, 13, 14].map((i) => a[i] - b[i])), 0.45), 1.6);
    const gl = this.gl;
    if (!gl) return;
    for (const { array, buffers } of this.meshes || []) {
      gl.deleteVertexArray(array);
      buffers.forEach((one) => gl.deleteBuffer(one));
    }
    const uploaded = new Map();
    this.meshes = glb.json.meshes.map(({ primitives: [{ attributes, indices, material }] }) => {
      const key = `${attributes.POSITION} ${indices}`;
      if (!uploaded.has(key)) {
        const array = gl.createVertexArray();
        gl.bindVertexArray(array);
        const buffers = [gl.createBuffer(), gl.createBuffer()];
        gl.bindBuffer(gl.ARRAY_BUFFER, buffers[0]);
        gl.bufferData(gl.ARRAY_BUFFER, glb.accessor(attributes.POSITION), gl.STATIC_DRAW);
        gl.enableVertexAttribArray(this.position);
        gl.vertexAttribPointer(this.position, 3, gl.FLOAT, false, 0, 0);
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[1]);
        const corners = glb.accessor(indices);
        gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
        gl.bindVertexArray(null);
        const kind = corners.BYTES_PER_ELEMENT === 2 ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT;
        uploaded.set(key, { array, buffers, n: corners.length, kind });
      }
      const { name, alphaMode, pbrMetallicRoughness } = glb.json.materials[material];
      return { ...uploaded.get(key), name, color: pbrMetallicRoughness.baseColorFactor, blends: alphaMode === "BLEND" };
    });
  }

  /* The poses of object and hand. */
  ends(poses) {
    const object = this.glb.json.nodes.findIndex((node) => node.name === "object");
    const hand = this.glb.json.nodes.findIndex((node, idx) => this.glb.parents[idx] === 0 && node.children);
    const both = [object, hand].filter((idx) => idx >= 0).map((idx) => poses[idx]);
    return [both[0] || Pose.identity(), both[both.length - 1] || Pose.identity()];
  }

  eye() {
    const { turn, rise, distance, target } = this.camera;
    return [target[0] + distance * Math.cos(rise) * Math.sin(turn), target[1] + distance * Math.sin(rise),
      target[2] + distance * Math.cos(rise) * Math.cos(turn)];
  }

  draw() {
    const gl = this.gl;
    if (!gl || !this.glb) return;
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(this.canvas.clientWidth * scale), height = Math.round(this.canvas.clientHeight * scale);
    if (width > 0 && (this.canvas.width !== width || this.canvas.height !== height)) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const poses = this.glb.poses(this.time);
    if (this.follow) {
      const [a, b] = this.ends(poses);
      this.camera.target = [12, 13, 14].map((i) => 0.55 * a[i] + 0.45 * b[i]);
    }
    const eye = this.eye();
    const clip = Pose.times(Pose.perspective(0.75, this.canvas.width / this.canvas.height, 0.01, 10),
      Pose.lookAt(eye, this.camera.target, [0, 1, 0]));
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.at.clipFromWorld, false, Float32Array.from(clip));
    gl.uniform3fv(this.at.eye, eye);
    gl.enable(gl.DEPTH_TEST);
    // Opaque things, then transparent ones, then contacts, which lie between surfaces, before everything.
    for (const turn of [0, 1, 2]) {
      if (turn === 2) { gl.disable(gl.DEPTH_TEST); gl.disable(gl.BLEND); }
      if (turn === 1) { gl.enable(gl.BLEND); gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA); gl.depthMask(false); }
      this.glb.json.nodes.forEach((node, idx) => {
        const mesh = node.mesh === undefined ? null : this.meshes[node.mesh];
        if (!mesh || (mesh.name === "contact" ? 2 : mesh.blends ? 1 : 0) !== turn || this.hidden[mesh.name]) return;
        gl.uniformMatrix4fv(this.at.worldFromMesh, false, Float32Array.from(poses[idx]));
        gl.uniform4fv(this.at.color, mesh.color);
        gl.uniform1i(this.at.table, mesh.name === "table" ? 1 : 0);
        gl.bindVertexArray(mesh.array);
        gl.drawElements(gl.TRIANGLES, mesh.n, mesh.kind, 0);
      });
    }
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
  }
}
