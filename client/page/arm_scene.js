// The arm in three dimensions: skeleton, probe, points, and a cloud of scanned points.
import { OrbitControls, THREE } from "nicegui-scene";

const COLOURS = {
  dark: { ground: 0x12161d, grid: 0x2b3340, link: 0x9fb2c8, joint: 0x5b7da3, probe: 0xff5a4f,
          good: 0x4fe08a, doubt: 0xffb02e, cloud: 0x5cc8ff },
  light: { ground: 0xf2f5f8, grid: 0xc9d2dc, link: 0x5d6b7c, joint: 0x2f5e93, probe: 0xd02a1e,
           good: 0x0b7a3e, doubt: 0x9a5b00, cloud: 0x0069b5 },
};
const VIEWS = {
  iso: [1, -1.2, 0.9], top: [0, -0.001, 1], front: [0, -1, 0], right: [1, 0, 0],
};
const WHILE_TURNING = 100000; // points
const UP = new THREE.Vector3(0, 1, 0); // a cylinder's own axis

export default {
  template: `<div class="arm-scene" role="img" aria-label="The arm, its points and scan in three dimensions">
    <canvas></canvas><div class="arm-scene-note" ref="note"></div></div>`,
  props: { cloudUrl: String },

  mounted() {
    const canvas = this.$el.querySelector("canvas");
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(40, 1, 1, 60000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => (this.dirty = true));
    this.controls.addEventListener("start", () => { this.follows = false; this.thin(true); });
    this.controls.addEventListener("end", () => this.thin(false));
    this.follows = true; // until somebody turns the view, all that has been seen is in it
    this.seen = new THREE.Box3();
    this.scene.add(new THREE.AmbientLight(0xffffff, 1.4));
    const sun = new THREE.DirectionalLight(0xffffff, 2.2);
    sun.position.set(1, -2, 3);
    this.scene.add(sun, new THREE.AxesHelper(250));
    this.materials = {};
    for (const name of ["link", "joint", "probe"])
      this.materials[name] = new THREE.MeshStandardMaterial({ roughness: 0.6 });
    this.arm = new THREE.Group();
    this.scene.add(this.arm);
    this.points = new Map(); // id -> mesh
    this.ball = new THREE.SphereGeometry(1, 16, 12);
    this.goodMaterial = new THREE.MeshStandardMaterial({ roughness: 0.5 });
    this.doubtMaterial = new THREE.MeshStandardMaterial({ roughness: 0.5 });
    this.cloudGeometry = new THREE.BufferGeometry();
    this.cloudMaterial = new THREE.PointsMaterial({ size: 2, sizeAttenuation: false });
    this.cloud = new THREE.Points(this.cloudGeometry, this.cloudMaterial);
    this.cloud.frustumCulled = false;
    this.doubtGeometry = new THREE.BufferGeometry(); // places of the cloud's, by row
    this.doubtfulMaterial = new THREE.PointsMaterial({ size: 3, sizeAttenuation: false });
    this.doubtful = new THREE.Points(this.doubtGeometry, this.doubtfulMaterial);
    this.doubtful.frustumCulled = false;
    this.doubts = [];
    this.scene.add(this.cloud, this.doubtful);
    this.drawn = { version: -1, n: 0, seen: 0, capacity: 0 };
    this.drawn_ms = {}; // of points, for measuring how long they took
    window.traverse_scene = this;
    this.theme(true);
    this.resizing = new ResizeObserver(() => this.resize());
    this.resizing.observe(this.$el);
    this.frames = 0;
    const draw = () => {
      this.frame = requestAnimationFrame(draw);
      if (!this.dirty) return;
      this.dirty = false;
      this.controls.update();
      this.renderer.render(this.scene, this.camera);
      this.frames += 1;
    };
    draw();
  },

  beforeUnmount() {
    cancelAnimationFrame(this.frame);
    this.resizing.disconnect();
    this.cloudGeometry.dispose();
    this.doubtGeometry.dispose();
    this.renderer.dispose();
  },

  methods: {
    resize() {
      const width = this.$el.clientWidth, height = this.$el.clientHeight;
      if (!width || !height) return;
      this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      if (this.follows && !this.seen.isEmpty()) this.look("iso", this.seen.clone());
      this.dirty = true;
    },

    theme(dark) {
      const colours = COLOURS[dark ? "dark" : "light"];
      this.scene.background = new THREE.Color(colours.ground);
      for (const name of ["link", "joint", "probe"]) this.materials[name].color.set(colours[name]);
      this.goodMaterial.color.set(colours.good);
      this.doubtMaterial.color.set(colours.doubt);
      this.cloudMaterial.color.set(colours.cloud);
      this.doubtfulMaterial.color.set(colours.doubt);
      if (this.grid) this.scene.remove(this.grid);
      this.grid = new THREE.GridHelper(2400, 24, colours.grid, colours.grid);
      this.grid.rotation.x = Math.PI / 2;
      this.scene.add(this.grid);
      this.dirty = true;
    },

    // skeleton: origins of the joints from the base outwards, then the ball [mm]
    pose(skeleton, radius_mm) {
      const places = skeleton.map((p) => new THREE.Vector3(...p));
      if (this.arm.children.length !== 2 * places.length - 1) this.build(places);
      const [links, joints] = [this.links, this.joints];
      places.forEach((place, i) => {
        joints[i].position.copy(place);
        if (i === places.length - 1) joints[i].scale.setScalar(Math.max(radius_mm, this.thick * 0.35));
        if (i === 0) return;
        const along = place.clone().sub(places[i - 1]), length = along.length();
        const link = links[i - 1];
        link.visible = length > 1e-6;
        link.position.copy(places[i - 1]).addScaledVector(along, 0.5);
        link.scale.y = Math.max(length, 1e-6);
        if (link.visible) link.quaternion.setFromUnitVectors(UP, along.divideScalar(length));
      });
      this.probe_mm = places[places.length - 1];
      this.dirty = true;
      if (this.follows && !places.every((place) => this.seen.containsPoint(place))) {
        for (const place of places) this.seen.expandByPoint(place);
        this.look("iso", this.seen.clone());
        this.seen.expandByScalar(0.03 * this.seen.getSize(new THREE.Vector3()).length());
      }
    },

    build(places) {
      this.arm.clear();
      let reach = 0;
      for (let i = 1; i < places.length; i++) reach += places[i].distanceTo(places[i - 1]);
      this.thick = Math.max(4, reach * 0.016);
      this.links = []; this.joints = [];
      places.forEach((_, i) => {
        const last = i === places.length - 1;
        const size = last ? 1 : this.thick * 1.25;
        const joint = new THREE.Mesh(new THREE.SphereGeometry(size, 24, 16),
                                     this.materials[last ? "probe" : "joint"]);
        this.joints.push(joint);
        this.arm.add(joint);
        if (i === 0) return;
        const thin = last ? 0.35 : 1;
        const link = new THREE.Mesh(
          new THREE.CylinderGeometry(this.thick * thin * 0.75, this.thick * thin, 1, 20),
          this.materials.link);
        this.links.push(link);
        this.arm.add(link);
      });
    },

    add_points(points) { // [[id, x, y, z, good], ...]
      for (const [id, x, y, z, good] of points) {
        const material = good ? this.goodMaterial : this.doubtMaterial;
        if (this.points.has(id)) {
          this.points.get(id).material = material; // an event may have put it in doubt
          continue;
        }
        const mesh = new THREE.Mesh(this.ball, material);
        mesh.position.set(x, y, z);
        mesh.scale.setScalar(this.thick ? this.thick * 0.4 : 6);
        this.points.set(id, mesh);
        this.scene.add(mesh);
      }
      this.dirty = true;
      requestAnimationFrame(() => {
        for (const [id] of points) this.drawn_ms[id] = Date.now();
      });
    },

    remove_points(ids) {
      for (const id of ids) {
        const mesh = this.points.get(id);
        if (mesh) { this.scene.remove(mesh); this.points.delete(id); this.dirty = true; }
      }
    },

    show_age(stale) {
      for (const name of ["link", "joint", "probe"]) {
        this.materials[name].transparent = stale;
        this.materials[name].opacity = stale ? 0.25 : 1;
        this.materials[name].needsUpdate = true;
      }
      this.dirty = true;
    },

    // What is wanted while something is fetched is fetched afterwards, the latest alone.
    async update_cloud(version) {
      this.wanted = { version };
      if (this.fetching) return;
      this.fetching = true;
      try {
        while (this.wanted) {
          const wanted = this.wanted;
          this.wanted = null;
          await this.fetch_cloud(wanted);
        }
      } finally { this.fetching = false; }
    },

    // Both counts of the note are of one answer: what was wanted may be older.
    async fetch_cloud({ version }) {
      if (version !== this.drawn.version) {
        this.drawn = { ...this.drawn, version, n: 0, seen: 0 };
        this.doubts = [];
      }
      const url = `${this.cloudUrl}?version=${version}&start=${this.drawn.n}`;
      const answer = await fetch(url);
      if (answer.ok) {
        const values = new Float32Array(await answer.arrayBuffer());
        if (values.length) this.append(values);
        this.drawn.seen = Number(answer.headers.get("x-seen"));
      }
      if (!this.cloudGeometry.index) this.cloudGeometry.setDrawRange(0, this.drawn.n);
      const [drawn, all] = [this.drawn.n, this.drawn.seen].map((n) => n.toLocaleString("en"));
      this.$refs.note.textContent = this.drawn.seen ? `${drawn} of ${all} scanned points drawn` : "";
      this.dirty = true;
    },

    // While the view is turned by hand one point in some is drawn, so that it follows.
    thin(moves) {
      const n = this.drawn.n, every = Math.ceil(n / WHILE_TURNING);
      this.dirty = true;
      if (!moves || every < 2) {
        this.cloudGeometry.setIndex(null);
        this.cloudGeometry.setDrawRange(0, n);
        return;
      }
      const rows = new Uint32Array(Math.floor(n / every));
      for (let i = 0; i < rows.length; i++) rows[i] = i * every;
      this.cloudGeometry.setIndex(new THREE.BufferAttribute(rows, 1));
      this.cloudGeometry.setDrawRange(0, rows.length);
    },

    append(rows) { // x, y, z, doubt
      const before = this.drawn.n, n = before + rows.length / 4;
      const values = rows.filter((_, i) => i % 4 !== 3);
      for (let i = 0; i < n - before; i++) if (rows[4 * i + 3]) this.doubts.push(before + i);
      if (n > this.drawn.capacity) {
        let capacity = Math.max(16384, this.drawn.capacity);
        while (capacity < n) capacity *= 2;
        const grown = new Float32Array(3 * capacity);
        if (this.places) grown.set(this.places.subarray(0, 3 * this.drawn.n));
        this.places = grown;
        this.cloudGeometry.dispose();
        this.cloudGeometry.setAttribute("position", new THREE.BufferAttribute(grown, 3));
        this.doubtGeometry.dispose();
        this.doubtGeometry.setAttribute("position", this.cloudGeometry.attributes.position);
        this.drawn.capacity = capacity;
      }
      this.places.set(values, 3 * this.drawn.n);
      const attribute = this.cloudGeometry.attributes.position;
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(3 * this.drawn.n, values.length);
      attribute.needsUpdate = true;
      this.doubtGeometry.setIndex(new THREE.BufferAttribute(new Uint32Array(this.doubts), 1));
      this.drawn.n = n;
    },

    view(name) {
      this.follows = false;
      const box = new THREE.Box3();
      const near = name === "probe" && this.probe_mm;
      if (near) box.setFromCenterAndSize(this.probe_mm, new THREE.Vector3(160, 160, 160));
      else {
        for (const joint of this.joints ?? []) box.expandByPoint(joint.position);
        for (const mesh of this.points.values()) box.expandByPoint(mesh.position);
        for (let i = 0; i < this.drawn.n; i += 1 + Math.floor(this.drawn.n / 2000))
          box.expandByPoint(new THREE.Vector3().fromArray(this.places, 3 * i));
      }
      if (!box.isEmpty()) this.look(name, box);
    },

    look(name, box) {
      const near = name === "probe";
      const centre = box.getCenter(new THREE.Vector3());
      const radius = Math.max(40, box.getSize(new THREE.Vector3()).length() / 2);
      const way = near ? this.camera.position.clone().sub(this.controls.target)
                       : new THREE.Vector3(...(VIEWS[name] ?? VIEWS.iso));
      const half = THREE.MathUtils.degToRad(this.camera.fov / 2);
      const distance = radius / Math.sin(Math.min(half, Math.atan(Math.tan(half) * this.camera.aspect)));
      this.controls.target.copy(centre);
      this.camera.position.copy(centre).addScaledVector(way.normalize(), distance);
      this.dirty = true;
    },
  },
};
