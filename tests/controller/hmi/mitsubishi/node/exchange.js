// One exchange with the npm package mcprotocol: writes the items of the first argument, then reads those of the second.
// Usage: node exchange.js '{"port": 1, "ascii": false, "frame": "1E", "write": {"D10": 5}, "read": ["D10", "X10,3"]}'
// Prints {"write_failed": ..., "read_failed": ..., "values": {...}}.
"use strict";

const McProtocol = require("mcprotocol");

const order = JSON.parse(process.argv[2]);
const connection = new McProtocol({ silent: true });
const result = { write_failed: null, read_failed: null, values: {} };

function end(code) {
    process.stdout.write(JSON.stringify(result) + "\n", () => process.exit(code));
}

function read() {
    if (order.read.length === 0) {
        end(0);
        return;
    }
    connection.addItems(order.read);
    connection.readAllItems((failed, values) => {
        result.read_failed = failed;
        result.values = values;
        end(0);
    });
}

connection.initiateConnection(
    { host: "127.0.0.1", port: order.port, ascii: order.ascii, frame: order.frame },
    (error) => {
        if (error !== undefined) {
            process.stderr.write(`${error}\n`);
            end(1);
            return;
        }
        const names = Object.keys(order.write);
        if (names.length === 0) {
            read();
            return;
        }
        connection.writeItems(names, Object.values(order.write), (failed) => {
            result.write_failed = failed;
            read();
        });
    },
);
