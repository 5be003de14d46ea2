// node_red_flow.js PORT OUT: prints a Node-RED flow that polls registers 0–64 and the mirror in DCBA each second with
// node-red-contrib-modbus and appends "order volume error-rate" lines to the file OUT.
const [port, out] = process.argv.slice(2);

const read = (id, address, decode) => ({
  id, z: "tab", x: 100, y: 100, type: "modbus-read", name: "read " + address, unitid: "1", dataType: "HoldingRegister", adr: String(address),
  quantity: "65", rate: "1", rateUnit: "s", showErrors: true, server: "client", wires: [[], [decode]],
});
// The second output of modbus-read carries the answer's bytes in msg.payload.buffer.
const decode = (id, order, method) => ({
  id, z: "tab", x: 300, y: 100, type: "function", name: order, outputs: 1, wires: [["file"]],
  func: `const b = msg.payload.buffer;
return { payload: "${order} " + b.${method}(20).toPrecision(6) + " " + b.${method}(72).toPrecision(6) };`,
});

console.log(JSON.stringify([
  { id: "tab", type: "tab", label: "granaryd" },
  { id: "client", type: "modbus-client", name: "granaryd", clienttype: "tcp", bufferCommands: true,
    tcpHost: "127.0.0.1", tcpPort: port, tcpType: "DEFAULT", unit_id: "1", commandDelay: "1", clientTimeout: "5000",
    reconnectOnTimeout: true, reconnectTimeout: "2000", parallelUnitIdsAllowed: true, failureLogEnabled: true },
  read("summary", 0, "high-word-first"),
  decode("high-word-first", "ABCD", "readFloatBE"),
  read("mirror", 2400, "low-byte-first"),
  decode("low-byte-first", "DCBA", "readFloatLE"),
  { id: "file", z: "tab", x: 500, y: 100, type: "file", filename: out, filenameType: "str", appendNewline: true,
    overwriteFile: "false", createDir: false, wires: [[]] },
], null, 2));
