// node scan.mjs mqtt://localhost bench-7        prints each block of a scan
import mqtt from "mqtt";
import { decode, ExtensionCodec } from "@msgpack/msgpack";

// Arrays are extension type 1: kind, size, dimensions, shape, little-endian elements.
const KINDS = {
  f4: Float32Array, f8: Float64Array, i1: Int8Array, i2: Int16Array, i4: Int32Array,
  i8: BigInt64Array, u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, u8: BigUint64Array,
  b1: Uint8Array,
};
const extensionCodec = new ExtensionCodec();
extensionCodec.register({
  type: 1,
  encode: () => null,
  decode: (bytes) => {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const Kind = KINDS[String.fromCharCode(bytes[0]) + bytes[1]];
    const shape = Array.from({ length: bytes[2] }, (_, i) => view.getUint32(3 + 4 * i, true));
    const elements = Uint8Array.from(bytes.subarray(3 + 4 * bytes[2])); // aligned
    return { shape, values: new Kind(elements.buffer) };
  },
});

const [broker = "mqtt://localhost", arm = "+"] = process.argv.slice(2);
const client = mqtt.connect(broker);
client.on("connect", () => client.subscribe(`traverse/${arm}/scan`));
client.on("message", (topic, bytes) => {
  const scan = decode(bytes, { extensionCodec, useBigInt64: true });
  const last = scan.xyz_mm.values.slice(-3);
  console.log(scan.scan, `${scan.seq}`, scan.xyz_mm.shape[0], Array.from(last).join(" "));
});
