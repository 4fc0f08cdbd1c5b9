// Exchanges with the npm package mcprotocol over one connection. Usage: node exchange.js PORT binary|ascii
// Each line of input is an order: {"write": {"D10": 5}, "read": ["D10", "X10,3"]}; the items are written, then read.
// Each line of output that starts with { is a result: {"write_failed": ..., "read_failed": ..., "values": {...}}.
"use strict";

const readline = require("readline");
const McProtocol = require("mcprotocol");

const [port, code] = process.argv.slice(2);
const connection = new McProtocol({ silent: true });

function read(order, result, done) {
    if (order.read.length === 0) {
        done(result);
        return;
    }
    connection.removeItems();
    connection.addItems(order.read);
    connection.readAllItems((failed, values) => {
        done({ ...result, read_failed: failed, values });
    });
}

function exchange(order, done) {
    const result = { write_failed: null, read_failed: null, values: {} };
    const names = Object.keys(order.write);
    if (names.length === 0) {
        read(order, result, done);
        return;
    }
    connection.writeItems(names, Object.values(order.write), (failed) => {
        read(order, { ...result, write_failed: failed }, done);
    });
}

connection.initiateConnection({ host: "127.0.0.1", port: Number(port), ascii: code === "ascii" }, (error) => {
    if (error !== undefined) {
        process.stderr.write(`${error}\n`);
        process.exit(1);
    }
    const lines = readline.createInterface({ input: process.stdin });
    lines.on("line", (line) => {
        exchange(JSON.parse(line), (result) => process.stdout.write(`\n${JSON.stringify(result)}\n`));
    });
    lines.on("close", () => process.exit(0));
});
