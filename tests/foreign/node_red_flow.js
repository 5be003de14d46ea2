// node_red_flow.js PORT OUT: prints the flow that docs/scada/ has for Node-RED, with the port set, and what it needs for
// a test: its figures are appended to the file OUT as "order volume error-rate" lines, and so are those of the mirror in
// DCBA at 2400. Without x and y Node-RED takes a node for a configuration.
const path = require("path");
const [port, out] = process.argv.slice(2);

const flow = require(path.join(__dirname, "../../docs/scada/node-red-flow.json"));
const tab = flow.find((node) => node.type === "tab").id;
const client = flow.find((node) => node.type === "modbus-client");
const names = flow.find((node) => node.type === "function");
client.tcpPort = port;
names.wires[0].push("line");

const at = (id, type, more) => ({ id, type, z: tab, x: 100, y: 200, ...more });
flow.push(
  at("line", "function", {
    outputs: 1, wires: [["file"]],
    func: 'return { payload: ["ABCD", msg.payload.volume.toPrecision(6), msg.payload.error_rate.toPrecision(6)].join(" ") };',
  }),
  at("mirror", "modbus-read", {
    name: "mirror in DCBA", unitid: "1", dataType: "InputRegister", adr: "2400", quantity: "65", rate: "1", rateUnit: "s",
    showErrors: true, server: client.id, wires: [[], ["decode"]],
  }),
  // The second output of modbus-read carries the answer's bytes.
  at("decode", "function", {
    outputs: 1, wires: [["file"]],
    func: `const bytes = msg.payload.buffer;
return { payload: ["DCBA", bytes.readFloatLE(20).toPrecision(6), bytes.readFloatLE(72).toPrecision(6)].join(" ") };`,
  }),
  at("file", "file", { filename: out, filenameType: "str", appendNewline: true, overwriteFile: "false", wires: [[]] }),
);
console.log(JSON.stringify(flow, null, 2));
