// node points.mjs mqtt://localhost bench-7      prints each point as it is captured
import mqtt from "mqtt";
import { decode } from "@msgpack/msgpack";

const [broker = "mqtt://localhost", arm = "+"] = process.argv.slice(2);
const client = mqtt.connect(broker);
client.on("connect", () => client.subscribe(`traverse/${arm}/point`, { qos: 1 }));
client.on("message", (topic, bytes) => {
  const point = bytes[0] === 0x7b ? JSON.parse(bytes) : decode(bytes, { useBigInt64: true });
  const what = point.retracts ? `takes back ${point.retracts}` : point.xyz_mm.join(" ");
  console.log(point.session, point.seq, what, point.quality.ok ? "" : point.quality.flags.join());
});
