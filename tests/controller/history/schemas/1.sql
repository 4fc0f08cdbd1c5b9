-- History with schema 1, as the first version of the program that had a history wrote it (git commit 983bbec6).
-- Made by the writer of that commit, with one record of each kind, and printed by sqlite3.Connection.iterdump.
PRAGMA page_size = 4096;
PRAGMA auto_vacuum = 2;
PRAGMA journal_mode = wal;
BEGIN TRANSACTION;
CREATE TABLE alarms (id INTEGER PRIMARY KEY, "utc_ms" INTEGER, "at_ms" INTEGER, "run" INTEGER, "number" INTEGER, "key" TEXT, "before" TEXT, "after" TEXT, "by_whom" TEXT, "text" TEXT, "shelved_until_ms" INTEGER);
INSERT INTO "alarms" VALUES(10,1790000009000,5000,1,7,'left.slide','normal','unacknowledged',NULL,'left slide does not move',NULL);
INSERT INTO "alarms" VALUES(11,1790000010000,6000,1,7,'left.slide','unacknowledged','acknowledged','Li','left slide does not move',NULL);
CREATE TABLE audit (id INTEGER PRIMARY KEY, "utc_ms" INTEGER, "at_ms" INTEGER, "run" INTEGER, "peer" TEXT, "who" TEXT, "what" TEXT, "value" TEXT, "result" TEXT);
INSERT INTO "audit" VALUES(12,1790000011000,7000,1,'127.0.0.1:40312','Li','clamp','120','done');
CREATE TABLE cycles (id INTEGER PRIMARY KEY, "utc_ms" INTEGER, "at_ms" INTEGER, "run" INTEGER, "side" TEXT, "row" INTEGER, "cycle_ms" INTEGER, "waiting_ms" INTEGER, "missed_cups" INTEGER, "gap_cause" TEXT, "edges" TEXT);
INSERT INTO "cycles" VALUES(9,1790000008000,4000,1,'left',2,5200,300,1,'waiting','[[0,"X10",1],[120,"Y4",1]]');
CREATE TABLE events (id INTEGER PRIMARY KEY, "utc_ms" INTEGER, "at_ms" INTEGER, "run" INTEGER, "kind" TEXT, "number" INTEGER, "text" TEXT, "detail" TEXT);
INSERT INTO "events" VALUES(2,1790000001000,0,1,'state',2,'Stopped','{}');
INSERT INTO "events" VALUES(3,1790000002000,10,1,'mode',1,'Production','{}');
INSERT INTO "events" VALUES(4,1790000003000,1000,1,'state',6,'Execute','{"reason":"start"}');
INSERT INTO "events" VALUES(5,1790000004000,1500,1,'question',1,'Is the tray empty?','{"question":"tray","active":true}');
INSERT INTO "events" VALUES(6,1790000005000,1900,1,'question',0,'Is the tray empty?','{"question":"tray","active":false}');
INSERT INTO "events" VALUES(7,1790000006000,2000,1,'refusal',3,'cannot hold: the machine is not running','{"command":"hold"}');
INSERT INTO "events" VALUES(8,1790000007000,3000,1,'tray',1,'','{}');
CREATE TABLE runs (id INTEGER PRIMARY KEY, "utc_ms" INTEGER, "at_ms" INTEGER, "run" INTEGER, "program" TEXT, "version" TEXT);
INSERT INTO "runs" VALUES(1,1790000000000,0,1,'transplanter','0.1.0');
COMMIT;
PRAGMA application_id = 1414548564;
PRAGMA user_version = 1;
