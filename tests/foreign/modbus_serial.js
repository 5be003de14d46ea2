// modbus_serial.js PORT: volume and error rate with npm's modbus-serial, ABCD at 10 and 36, and DCBA from the mirror at
// 2400, which is what Buffer.readFloatLE reads.
const ModbusRTU = require("modbus-serial");

async function main() {
  const client = new ModbusRTU();
  await client.connectTCP("127.0.0.1", { port: Number(process.argv[2]) });
  client.setID(1);
  client.setTimeout(5000);
  const block = (await client.readHoldingRegisters(0, 65)).buffer;
  const print = (order, volume, rate) => console.log(order, volume.toPrecision(6), rate.toPrecision(6));
  print("ABCD", block.readFloatBE(20), block.readFloatBE(72));
  const mirror = (await client.readInputRegisters(2400, 65)).buffer;
  print("DCBA", mirror.readFloatLE(20), mirror.readFloatLE(72));
  client.close(() => process.exit(0));
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
