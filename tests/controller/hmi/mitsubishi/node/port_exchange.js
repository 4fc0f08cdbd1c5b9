// Calls of the npm package node-fxplc over one connection. Usage: node port_exchange.js PORT
// Each line of input is a list of calls, [["writeInt", "D10", 5], ["readInt", "D10"]], made one after another.
// Each line of output is the list of their results; a refused call has the name of its error.
"use strict";

const readline = require("readline");
const { FXPLCClient, TransportTCP } = require("node-fxplc");

const transport = new TransportTCP({ host: "127.0.0.1", port: Number(process.argv[2]), timeout: 60000, flushDelay: 0 });
const client = new FXPLCClient(transport, { timeoutMs: 60000 });
client.on("error", () => {}); // every call also rejects

async function results(calls) {
    const found = [];
    for (const [name, ...values] of calls) {
        try {
            found.push((await client[name](...values)) ?? null);
        } catch (error) {
            found.push(error.constructor.name);
        }
    }
    return found;
}

async function main() {
    for await (const line of readline.createInterface({ input: process.stdin })) {
        process.stdout.write(`${JSON.stringify(await results(JSON.parse(line)))}\n`);
    }
    client.close();
    process.exit(0);
}

main();
