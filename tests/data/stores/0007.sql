BEGIN TRANSACTION;
CREATE TABLE aggregate (
	id INTEGER NOT NULL, 
	name TEXT NOT NULL, 
	delivery TEXT NOT NULL, 
	particle_density_kg_m3 DOUBLE, 
	density_basis VARCHAR(16), 
	water_absorption_percent DOUBLE, 
	shape TEXT, 
	source TEXT, 
	repose_angle_deg DOUBLE, 
	wall_angle_deg DOUBLE, 
	created_at DATETIME NOT NULL, version INTEGER DEFAULT '1' NOT NULL, 
	CONSTRAINT pk_aggregate PRIMARY KEY (id), 
	CONSTRAINT ck_aggregate_density_basis CHECK (density_basis IS NULL OR density_basis IN ('oven_dry', 'ssd', 'apparent')), 
	CONSTRAINT ck_aggregate_name CHECK (name <> ''), 
	CONSTRAINT ck_aggregate_density_has_basis CHECK ((particle_density_kg_m3 IS NULL) = (density_basis IS NULL)), 
	CONSTRAINT ck_aggregate_particle_density CHECK (particle_density_kg_m3 > 0), 
	CONSTRAINT ck_aggregate_absorption CHECK (water_absorption_percent >= 0 AND water_absorption_percent < 100), 
	CONSTRAINT uq_aggregate_name_delivery UNIQUE (name, delivery)
);
INSERT INTO "aggregate" VALUES(1,'pebbles L','',NULL,NULL,NULL,'round pebbles','Feret, fraction L; in Gillette and Hill, Concrete Construction: Methods and Costs, 1908, chapter I',NULL,NULL,'2026-12-01 04:05:28.358464',1);
INSERT INTO "aggregate" VALUES(2,'pebbles M','',NULL,NULL,NULL,'round pebbles','Feret, fraction M; in Gillette and Hill, Concrete Construction: Methods and Costs, 1908, chapter I',NULL,NULL,'2026-12-01 04:05:28.358471',1);
INSERT INTO "aggregate" VALUES(3,'pebbles F','',NULL,NULL,NULL,'round pebbles','Feret, fraction F; in Gillette and Hill, Concrete Construction: Methods and Costs, 1908, chapter I',NULL,NULL,'2026-12-01 04:05:28.358472',1);
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0007');
CREATE TABLE "calibration" (
	id INTEGER NOT NULL, 
	aggregate_id INTEGER NOT NULL, 
	sieve_analysis_id INTEGER NOT NULL, 
	packing_test_id INTEGER, 
	method VARCHAR(32) NOT NULL, 
	protocol TEXT NOT NULL, 
	engine_version INTEGER, 
	diameter_rule VARCHAR(32) NOT NULL, 
	diameter_mm DOUBLE NOT NULL, 
	measured_packing_density DOUBLE, 
	friction DOUBLE, 
	friction_low DOUBLE, 
	friction_high DOUBLE, 
	rolling_friction DOUBLE, 
	packing_density DOUBLE, 
	input_error DOUBLE, 
	curve_error DOUBLE, 
	warnings TEXT, 
	state VARCHAR(16) NOT NULL, 
	requested_at DATETIME NOT NULL, 
	finished_at DATETIME, 
	priority INTEGER NOT NULL, 
	progress DOUBLE NOT NULL, 
	message TEXT, 
	claimed_by TEXT, 
	heartbeat DATETIME, 
	variant VARCHAR(64) DEFAULT '' NOT NULL, 
	spheres TEXT, 
	leave_out_below_mm DOUBLE, 
	measured_angle_deg DOUBLE, 
	wall_friction DOUBLE, 
	rolling_friction_low DOUBLE, 
	rolling_friction_high DOUBLE, asked TEXT, 
	CONSTRAINT pk_calibration PRIMARY KEY (id), 
	CONSTRAINT fk_calibration_packing_test_id_packing_test FOREIGN KEY(packing_test_id) REFERENCES packing_test (id), 
	CONSTRAINT ck_calibration_friction CHECK (friction >= 0 AND friction_low >= 0 AND friction_high >= 0), 
	CONSTRAINT ck_calibration_state CHECK (state IN ('queued', 'running', 'done', 'failed', 'cancelled')), 
	CONSTRAINT ck_calibration_diameter CHECK (diameter_mm > 0), 
	CONSTRAINT ck_calibration_done_has_result CHECK (state <> 'done' OR friction IS NOT NULL), 
	CONSTRAINT fk_calibration_sieve_analysis_id_sieve_analysis FOREIGN KEY(sieve_analysis_id) REFERENCES sieve_analysis (id), 
	CONSTRAINT fk_calibration_aggregate_id_aggregate FOREIGN KEY(aggregate_id) REFERENCES aggregate (id), 
	CONSTRAINT ck_calibration_progress CHECK (progress BETWEEN 0 AND 1), 
	CONSTRAINT ck_calibration_leave_out_below CHECK (leave_out_below_mm > 0), 
	CONSTRAINT ck_calibration_measured_angle CHECK (measured_angle_deg BETWEEN 0 AND 90), 
	CONSTRAINT ck_calibration_wall_friction CHECK (wall_friction >= 0), 
	CONSTRAINT ck_calibration_rolling_friction CHECK (rolling_friction >= 0 AND rolling_friction_low >= 0 AND rolling_friction_high >= 0)
);
INSERT INTO "calibration" VALUES(1,1,1,1,'monosized','{"cloud_fraction": 0.25, "compaction": "loose", "container": "periodic", "local_damping": 0.7, "moment_damping": false, "nominal_overlap": 0.002, "restitution": 0.5, "steps_per_collision": 10.0, "wall_friction": null}',1,'log_mean',4.97736315733541800909e+01,0.6,0.03736,2.62158376531516600083e-02,5.22156234613686057177e-02,NULL,6.00001460210380255233e-01,0.005,4.6962733725908954686e-04,'the density test''s compaction is not stated: it is simulated as loose
no standard deviation stated: a standard error of 0.005 in PD is assumed','done','2026-12-01 04:05:28.443474','2026-12-01 04:05:28.443463',0,1.0,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "calibration" VALUES(2,2,2,2,'monosized','{"cloud_fraction": 0.25, "compaction": "loose", "container": "periodic", "local_damping": 0.7, "moment_damping": false, "nominal_overlap": 0.002, "restitution": 0.5, "steps_per_collision": 10.0, "wall_friction": null}',1,'log_mean',2.87368195874212872809e+01,6.12000000000000099475e-01,0.01519,9.66496703731123743552e-03,2.25924728055826480599e-02,NULL,6.12000950752050187908e-01,0.005,7.07418781199924866578e-04,'the density test''s compaction is not stated: it is simulated as loose
no standard deviation stated: a standard error of 0.005 in PD is assumed','done','2026-12-01 04:05:28.449080','2026-12-01 04:05:28.449071',0,1.0,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "calibration" VALUES(3,3,3,3,'monosized','{"cloud_fraction": 0.25, "compaction": "loose", "container": "periodic", "local_damping": 0.7, "moment_damping": false, "nominal_overlap": 0.002, "restitution": 0.5, "steps_per_collision": 10.0, "wall_friction": null}',1,'log_mean',1.43684097937106436404e+01,0.583,0.1102,8.11568092268190460769e-02,1.47926237007620198227e-01,NULL,5.83003985908782662583e-01,0.005,3.01333068240490281261e-04,'the density test''s compaction is not stated: it is simulated as loose
no standard deviation stated: a standard error of 0.005 in PD is assumed','done','2026-12-01 04:05:28.453032','2026-12-01 04:05:28.453023',0,1.0,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL);
CREATE TABLE calibration_run (
	calibration_id INTEGER NOT NULL, 
	specimen_hash VARCHAR(64) NOT NULL, 
	CONSTRAINT pk_calibration_run PRIMARY KEY (calibration_id, specimen_hash), 
	CONSTRAINT fk_calibration_run_calibration_id_calibration FOREIGN KEY(calibration_id) REFERENCES calibration (id), 
	CONSTRAINT fk_calibration_run_specimen_hash_run FOREIGN KEY(specimen_hash) REFERENCES run (specimen_hash)
);
INSERT INTO "calibration_run" VALUES(1,'0b27bdf25f2b4178c72e43d53765b6bb60df93dea6d0f63228c9618770d11838');
INSERT INTO "calibration_run" VALUES(1,'0bc446e29ec975cb6b99c7bb6261ded0a72a6bec8fd674d57e39c2d8f7a7c2fd');
INSERT INTO "calibration_run" VALUES(1,'28a014bbfe8ed8a6943261a112ae28dba9a756b7af1871d81151bacf4cb61576');
INSERT INTO "calibration_run" VALUES(1,'28aba6f1bdb952157fe5e8740580d1a12920c18ff4fa4d8ae5b8b02f01a07922');
INSERT INTO "calibration_run" VALUES(1,'2b0f43df3793f1565c901cf0e035491082dc902c42f2b8323fc33928b247ed6a');
INSERT INTO "calibration_run" VALUES(1,'3c2daf05156e21819867dfb914a6ccbae3be26bf0c177265ec4fdd7be0e7b030');
INSERT INTO "calibration_run" VALUES(1,'4aa7dfbdb9f26f9a819a66517412342a95c41581433689197e4072fe9794d22e');
INSERT INTO "calibration_run" VALUES(1,'565639ee1d5f9e4ad89f62c76b0213312e38f1b54d42b5ee19ff0fb436645e61');
INSERT INTO "calibration_run" VALUES(1,'5e8780095b0b0323878f8c2e9f1b495e7b3ee6e58a508d7484fdcabf328afb09');
INSERT INTO "calibration_run" VALUES(1,'6989d974da5a6cbd51e6a16c60f44a3d144face341ea856e7bfc47a93f192e35');
INSERT INTO "calibration_run" VALUES(1,'73dfa520d0ca6f1c2654ebf986c36a8119f12e91f03a203fc838ced17eacdc65');
INSERT INTO "calibration_run" VALUES(1,'8582a4f0b3dcbd3cbf2b5d15157a885954bb7edfc71a59e0fe249bfa03333368');
INSERT INTO "calibration_run" VALUES(1,'9106ed140c37d4f8e17bdc77e8f25246840c8cda79d77701cb86c9b8f1631c9c');
INSERT INTO "calibration_run" VALUES(1,'91995be5ac75f1c3b2da0ebe00c2f61742ea6b5409a95bdd34fb7c7f341a7432');
INSERT INTO "calibration_run" VALUES(1,'951fcf4ae7dbb9484c0144a39d14d0cedf56be9bbcebbb73ec53df6357ef4306');
INSERT INTO "calibration_run" VALUES(1,'97bcf5a716b37f3acfcc345418f0bdbc946c54d87327ea18fda9da78c06e3ea6');
INSERT INTO "calibration_run" VALUES(1,'be520a7024b26b516554e36bbcc76574669d23e234ec020f44dcc17fd2b45b9b');
INSERT INTO "calibration_run" VALUES(1,'dcd7c8ed93c88b769f5f692d10d8d915decbbdfd913e321bdf52c6928bd7e064');
INSERT INTO "calibration_run" VALUES(1,'f0cdbda5eb4dfcb72cb21e74da193a2ddcf49ff1b0e3bff0f063b626f4fd6b64');
INSERT INTO "calibration_run" VALUES(1,'f7fe06b0270d179f125566804cc92be86ed93a292672cb137c755f84e6ac1a8a');
INSERT INTO "calibration_run" VALUES(2,'0b27bdf25f2b4178c72e43d53765b6bb60df93dea6d0f63228c9618770d11838');
INSERT INTO "calibration_run" VALUES(2,'0bc446e29ec975cb6b99c7bb6261ded0a72a6bec8fd674d57e39c2d8f7a7c2fd');
INSERT INTO "calibration_run" VALUES(2,'28a014bbfe8ed8a6943261a112ae28dba9a756b7af1871d81151bacf4cb61576');
INSERT INTO "calibration_run" VALUES(2,'28aba6f1bdb952157fe5e8740580d1a12920c18ff4fa4d8ae5b8b02f01a07922');
INSERT INTO "calibration_run" VALUES(2,'2b0f43df3793f1565c901cf0e035491082dc902c42f2b8323fc33928b247ed6a');
INSERT INTO "calibration_run" VALUES(2,'3c2daf05156e21819867dfb914a6ccbae3be26bf0c177265ec4fdd7be0e7b030');
INSERT INTO "calibration_run" VALUES(2,'4aa7dfbdb9f26f9a819a66517412342a95c41581433689197e4072fe9794d22e');
INSERT INTO "calibration_run" VALUES(2,'565639ee1d5f9e4ad89f62c76b0213312e38f1b54d42b5ee19ff0fb436645e61');
INSERT INTO "calibration_run" VALUES(2,'5e8780095b0b0323878f8c2e9f1b495e7b3ee6e58a508d7484fdcabf328afb09');
INSERT INTO "calibration_run" VALUES(2,'6989d974da5a6cbd51e6a16c60f44a3d144face341ea856e7bfc47a93f192e35');
INSERT INTO "calibration_run" VALUES(2,'73dfa520d0ca6f1c2654ebf986c36a8119f12e91f03a203fc838ced17eacdc65');
INSERT INTO "calibration_run" VALUES(2,'8582a4f0b3dcbd3cbf2b5d15157a885954bb7edfc71a59e0fe249bfa03333368');
INSERT INTO "calibration_run" VALUES(2,'9106ed140c37d4f8e17bdc77e8f25246840c8cda79d77701cb86c9b8f1631c9c');
INSERT INTO "calibration_run" VALUES(2,'91995be5ac75f1c3b2da0ebe00c2f61742ea6b5409a95bdd34fb7c7f341a7432');
INSERT INTO "calibration_run" VALUES(2,'951fcf4ae7dbb9484c0144a39d14d0cedf56be9bbcebbb73ec53df6357ef4306');
INSERT INTO "calibration_run" VALUES(2,'97bcf5a716b37f3acfcc345418f0bdbc946c54d87327ea18fda9da78c06e3ea6');
INSERT INTO "calibration_run" VALUES(2,'be520a7024b26b516554e36bbcc76574669d23e234ec020f44dcc17fd2b45b9b');
INSERT INTO "calibration_run" VALUES(2,'dcd7c8ed93c88b769f5f692d10d8d915decbbdfd913e321bdf52c6928bd7e064');
INSERT INTO "calibration_run" VALUES(2,'f0cdbda5eb4dfcb72cb21e74da193a2ddcf49ff1b0e3bff0f063b626f4fd6b64');
INSERT INTO "calibration_run" VALUES(2,'f7fe06b0270d179f125566804cc92be86ed93a292672cb137c755f84e6ac1a8a');
INSERT INTO "calibration_run" VALUES(3,'0b27bdf25f2b4178c72e43d53765b6bb60df93dea6d0f63228c9618770d11838');
INSERT INTO "calibration_run" VALUES(3,'0bc446e29ec975cb6b99c7bb6261ded0a72a6bec8fd674d57e39c2d8f7a7c2fd');
INSERT INTO "calibration_run" VALUES(3,'28a014bbfe8ed8a6943261a112ae28dba9a756b7af1871d81151bacf4cb61576');
INSERT INTO "calibration_run" VALUES(3,'28aba6f1bdb952157fe5e8740580d1a12920c18ff4fa4d8ae5b8b02f01a07922');
INSERT INTO "calibration_run" VALUES(3,'2b0f43df3793f1565c901cf0e035491082dc902c42f2b8323fc33928b247ed6a');
INSERT INTO "calibration_run" VALUES(3,'3c2daf05156e21819867dfb914a6ccbae3be26bf0c177265ec4fdd7be0e7b030');
INSERT INTO "calibration_run" VALUES(3,'4aa7dfbdb9f26f9a819a66517412342a95c41581433689197e4072fe9794d22e');
INSERT INTO "calibration_run" VALUES(3,'565639ee1d5f9e4ad89f62c76b0213312e38f1b54d42b5ee19ff0fb436645e61');
INSERT INTO "calibration_run" VALUES(3,'5e8780095b0b0323878f8c2e9f1b495e7b3ee6e58a508d7484fdcabf328afb09');
INSERT INTO "calibration_run" VALUES(3,'6989d974da5a6cbd51e6a16c60f44a3d144face341ea856e7bfc47a93f192e35');
INSERT INTO "calibration_run" VALUES(3,'73dfa520d0ca6f1c2654ebf986c36a8119f12e91f03a203fc838ced17eacdc65');
INSERT INTO "calibration_run" VALUES(3,'8582a4f0b3dcbd3cbf2b5d15157a885954bb7edfc71a59e0fe249bfa03333368');
INSERT INTO "calibration_run" VALUES(3,'9106ed140c37d4f8e17bdc77e8f25246840c8cda79d77701cb86c9b8f1631c9c');
INSERT INTO "calibration_run" VALUES(3,'91995be5ac75f1c3b2da0ebe00c2f61742ea6b5409a95bdd34fb7c7f341a7432');
INSERT INTO "calibration_run" VALUES(3,'951fcf4ae7dbb9484c0144a39d14d0cedf56be9bbcebbb73ec53df6357ef4306');
INSERT INTO "calibration_run" VALUES(3,'97bcf5a716b37f3acfcc345418f0bdbc946c54d87327ea18fda9da78c06e3ea6');
INSERT INTO "calibration_run" VALUES(3,'be520a7024b26b516554e36bbcc76574669d23e234ec020f44dcc17fd2b45b9b');
INSERT INTO "calibration_run" VALUES(3,'dcd7c8ed93c88b769f5f692d10d8d915decbbdfd913e321bdf52c6928bd7e064');
INSERT INTO "calibration_run" VALUES(3,'f0cdbda5eb4dfcb72cb21e74da193a2ddcf49ff1b0e3bff0f063b626f4fd6b64');
INSERT INTO "calibration_run" VALUES(3,'f7fe06b0270d179f125566804cc92be86ed93a292672cb137c755f84e6ac1a8a');
CREATE TABLE comparison (
	mixture_id INTEGER NOT NULL, 
	method VARCHAR(32) NOT NULL, 
	mixture TEXT NOT NULL, 
	prediction_id INTEGER, 
	state VARCHAR(16) NOT NULL, 
	engine_version INTEGER, 
	predicted DOUBLE, 
	standard_error DOUBLE, 
	input_error DOUBLE, 
	compaction TEXT, 
	measured DOUBLE, 
	difference DOUBLE, 
	message TEXT, 
	warnings TEXT, 
	outdated TEXT, 
	requested_at DATETIME, simulated TEXT, 
	CONSTRAINT pk_comparison PRIMARY KEY (mixture_id, method), 
	CONSTRAINT fk_comparison_mixture_id_mixture FOREIGN KEY(mixture_id) REFERENCES mixture (id) ON DELETE CASCADE, 
	CONSTRAINT fk_comparison_prediction_id_prediction FOREIGN KEY(prediction_id) REFERENCES prediction (id) ON DELETE CASCADE
);
INSERT INTO "comparison" VALUES(1,'monosized','pebbles L+M 1:1',1,'done',1,6.33469177790757731472e-01,7.08089402981381299713e-04,3.86521425614169689133e-03,'unstated',0.642,-8.5308222092422836269e-03,NULL,NULL,NULL,'2026-12-01 04:05:28.473881','loose');
INSERT INTO "comparison" VALUES(2,'monosized','pebbles L+F 1:1',2,'done',1,6.36216059279212875487e-01,4.58377131982279589859e-04,0.00409452042660351,'unstated',6.43999999999999905853e-01,-0.00778394072078703,NULL,NULL,NULL,'2026-12-01 04:05:28.480515','loose');
INSERT INTO "comparison" VALUES(3,'monosized','pebbles M+F 1:1',3,'done',1,6.36786886922265815691e-01,6.03904719485075084685e-04,4.02758874594354079196e-03,'unstated',0.621,1.57868869222658192441e-02,NULL,NULL,NULL,'2026-12-01 04:05:28.485462','loose');
CREATE TABLE correction (
	id INTEGER NOT NULL, 
	table_name VARCHAR(32) NOT NULL, 
	row_key TEXT NOT NULL, 
	column_name VARCHAR(32) NOT NULL, 
	old_value TEXT, 
	new_value TEXT, 
	corrected_by TEXT NOT NULL, 
	reason TEXT, 
	corrected_at DATETIME NOT NULL, 
	CONSTRAINT pk_correction PRIMARY KEY (id), 
	CONSTRAINT ck_correction_table_name CHECK (table_name IN ('aggregate', 'sieve_analysis', 'sieve_result', 'packing_test', 'mixture', 'mixture_component')), 
	CONSTRAINT ck_correction_corrected_by CHECK (corrected_by <> '')
);
CREATE TABLE draft (
	id INTEGER NOT NULL, 
	kind VARCHAR(16) NOT NULL, 
	content TEXT NOT NULL, 
	created_at DATETIME NOT NULL, 
	saved_at DATETIME NOT NULL, 
	CONSTRAINT pk_draft PRIMARY KEY (id), 
	CONSTRAINT ck_draft_kind CHECK (kind IN ('aggregate', 'mixture'))
);
INSERT INTO "draft" VALUES(1,'aggregate','{"name": "sand"}','2026-02-03 04:05:06.000789','2026-02-03 04:05:06.000789');
CREATE TABLE mark (
	name VARCHAR(32) NOT NULL, 
	value VARCHAR(32) NOT NULL, 
	CONSTRAINT pk_mark PRIMARY KEY (name)
);
INSERT INTO "mark" VALUES('comparison','dcb81ff25fa6409087f3de2d54c0da0a');
CREATE TABLE mixture (
	id INTEGER NOT NULL, 
	name TEXT NOT NULL, 
	created_at DATETIME NOT NULL, version INTEGER DEFAULT '1' NOT NULL, 
	CONSTRAINT pk_mixture PRIMARY KEY (id), 
	CONSTRAINT ck_mixture_name CHECK (name <> ''), 
	CONSTRAINT uq_mixture_name UNIQUE (name)
);
INSERT INTO "mixture" VALUES(1,'pebbles L+M 1:1','2026-12-01 04:05:28.363436',1);
INSERT INTO "mixture" VALUES(2,'pebbles L+F 1:1','2026-12-01 04:05:28.363442',1);
INSERT INTO "mixture" VALUES(3,'pebbles M+F 1:1','2026-12-01 04:05:28.363443',1);
CREATE TABLE mixture_component (
	mixture_id INTEGER NOT NULL, 
	position INTEGER NOT NULL, 
	aggregate_id INTEGER NOT NULL, 
	solid_volume_share DOUBLE NOT NULL, 
	mass_share DOUBLE, 
	CONSTRAINT pk_mixture_component PRIMARY KEY (mixture_id, position), 
	CONSTRAINT ck_mixture_component_mass_share CHECK (mass_share > 0 AND mass_share <= 1), 
	CONSTRAINT ck_mixture_component_solid_volume_share CHECK (solid_volume_share > 0 AND solid_volume_share <= 1), 
	CONSTRAINT fk_mixture_component_aggregate_id_aggregate FOREIGN KEY(aggregate_id) REFERENCES aggregate (id), 
	CONSTRAINT fk_mixture_component_mixture_id_mixture FOREIGN KEY(mixture_id) REFERENCES mixture (id), 
	CONSTRAINT uq_mixture_component_mixture_id_aggregate_id UNIQUE (mixture_id, aggregate_id)
);
INSERT INTO "mixture_component" VALUES(1,0,1,0.5,NULL);
INSERT INTO "mixture_component" VALUES(1,1,2,0.5,NULL);
INSERT INTO "mixture_component" VALUES(2,0,1,0.5,NULL);
INSERT INTO "mixture_component" VALUES(2,1,3,0.5,NULL);
INSERT INTO "mixture_component" VALUES(3,0,2,0.5,NULL);
INSERT INTO "mixture_component" VALUES(3,1,3,0.5,NULL);
CREATE TABLE "packing_test" (
	id INTEGER NOT NULL, 
	aggregate_id INTEGER, 
	mixture_id INTEGER, 
	compaction VARCHAR(16) NOT NULL, 
	bulk_density_kg_m3 DOUBLE, 
	voids_percent DOUBLE, 
	packing_density DOUBLE, 
	repeats INTEGER, 
	standard_deviation DOUBLE, 
	container_diameter_mm DOUBLE, 
	container_height_mm DOUBLE, 
	standard TEXT, 
	date DATE, 
	raw_text TEXT NOT NULL, 
	created_at DATETIME NOT NULL, 
	version INTEGER DEFAULT '1' NOT NULL, 
	moisture_percent DOUBLE, 
	CONSTRAINT pk_packing_test PRIMARY KEY (id), 
	CONSTRAINT fk_packing_test_aggregate_id_aggregate FOREIGN KEY(aggregate_id) REFERENCES aggregate (id), 
	CONSTRAINT fk_packing_test_mixture_id_mixture FOREIGN KEY(mixture_id) REFERENCES mixture (id), 
	CONSTRAINT ck_packing_test_one_value CHECK (CASE WHEN bulk_density_kg_m3 IS NULL THEN 0 ELSE 1 END + CASE WHEN voids_percent IS NULL THEN 0 ELSE 1 END + CASE WHEN packing_density IS NULL THEN 0 ELSE 1 END = 1), 
	CONSTRAINT ck_packing_test_packing_density CHECK (packing_density > 0 AND packing_density < 1), 
	CONSTRAINT ck_packing_test_voids CHECK (voids_percent > 0 AND voids_percent < 100), 
	CONSTRAINT ck_packing_test_bulk_density CHECK (bulk_density_kg_m3 > 0), 
	CONSTRAINT ck_packing_test_compaction CHECK (compaction IN ('loose', 'rodded', 'vibrated', 'unstated')), 
	CONSTRAINT ck_packing_test_container CHECK (container_diameter_mm > 0 AND container_height_mm > 0), 
	CONSTRAINT ck_packing_test_repeats CHECK (repeats >= 1), 
	CONSTRAINT ck_packing_test_one_material CHECK ((aggregate_id IS NULL) <> (mixture_id IS NULL)), 
	CONSTRAINT ck_packing_test_standard_deviation CHECK (standard_deviation >= 0), 
	CONSTRAINT ck_packing_test_moisture CHECK (moisture_percent >= 0 AND moisture_percent < 100)
);
INSERT INTO "packing_test" VALUES(1,1,NULL,'unstated',NULL,40.0,NULL,NULL,NULL,NULL,NULL,NULL,NULL,'material=pebbles L	compaction=unstated	voids_percent=40.0','2026-12-01 04:05:28.366256',1,NULL);
INSERT INTO "packing_test" VALUES(2,2,NULL,'unstated',NULL,38.8,NULL,NULL,NULL,NULL,NULL,NULL,NULL,'material=pebbles M	compaction=unstated	voids_percent=38.8','2026-12-01 04:05:28.366261',1,NULL);
INSERT INTO "packing_test" VALUES(3,3,NULL,'unstated',NULL,41.7,NULL,NULL,NULL,NULL,NULL,NULL,NULL,'material=pebbles F	compaction=unstated	voids_percent=41.7','2026-12-01 04:05:28.366262',1,NULL);
INSERT INTO "packing_test" VALUES(4,NULL,1,'unstated',NULL,35.8,NULL,NULL,NULL,NULL,NULL,NULL,NULL,'material=pebbles L+M 1:1	compaction=unstated	voids_percent=35.8','2026-12-01 04:05:28.366263',1,NULL);
INSERT INTO "packing_test" VALUES(5,NULL,2,'unstated',NULL,35.6,NULL,NULL,NULL,NULL,NULL,NULL,NULL,'material=pebbles L+F 1:1	compaction=unstated	voids_percent=35.6','2026-12-01 04:05:28.366263',1,NULL);
INSERT INTO "packing_test" VALUES(6,NULL,3,'unstated',NULL,37.9,NULL,NULL,NULL,NULL,NULL,NULL,NULL,'material=pebbles M+F 1:1	compaction=unstated	voids_percent=37.9','2026-12-01 04:05:28.366264',1,NULL);
CREATE TABLE prediction (
	id INTEGER NOT NULL, 
	mixture_id INTEGER NOT NULL, 
	method VARCHAR(32) NOT NULL, 
	protocol TEXT NOT NULL, 
	engine_version INTEGER, 
	packing_density DOUBLE, 
	standard_error DOUBLE, 
	input_error DOUBLE, 
	warnings TEXT, 
	state VARCHAR(16) NOT NULL, 
	requested_at DATETIME NOT NULL, 
	finished_at DATETIME, 
	priority INTEGER NOT NULL, 
	progress DOUBLE NOT NULL, 
	message TEXT, 
	claimed_by TEXT, 
	heartbeat DATETIME, variant VARCHAR(64) DEFAULT '' NOT NULL, asked TEXT, 
	CONSTRAINT pk_prediction PRIMARY KEY (id), 
	CONSTRAINT ck_prediction_done_has_result CHECK (state <> 'done' OR packing_density IS NOT NULL), 
	CONSTRAINT ck_prediction_state CHECK (state IN ('queued', 'running', 'done', 'failed', 'cancelled')), 
	CONSTRAINT ck_prediction_packing_density CHECK (packing_density > 0 AND packing_density < 1), 
	CONSTRAINT ck_prediction_progress CHECK (progress BETWEEN 0 AND 1), 
	CONSTRAINT ck_prediction_errors CHECK (standard_error >= 0 AND input_error >= 0), 
	CONSTRAINT fk_prediction_mixture_id_mixture FOREIGN KEY(mixture_id) REFERENCES mixture (id)
);
INSERT INTO "prediction" VALUES(1,1,'monosized','{"cloud_fraction": 0.25, "compaction": "loose", "container": "periodic", "local_damping": 0.7, "moment_damping": false, "nominal_overlap": 0.002, "restitution": 0.5, "steps_per_collision": 10.0, "wall_friction": null}',1,6.33469177790757731472e-01,7.08089402981381299713e-04,3.86521425614169689133e-03,NULL,'done','2026-12-01 04:05:28.473881','2026-12-01 04:05:28.473868',0,1.0,NULL,NULL,NULL,'',NULL);
INSERT INTO "prediction" VALUES(2,2,'monosized','{"cloud_fraction": 0.25, "compaction": "loose", "container": "periodic", "local_damping": 0.7, "moment_damping": false, "nominal_overlap": 0.002, "restitution": 0.5, "steps_per_collision": 10.0, "wall_friction": null}',1,6.36216059279212875487e-01,4.58377131982279589859e-04,0.00409452042660351,NULL,'done','2026-12-01 04:05:28.480515','2026-12-01 04:05:28.480507',0,1.0,NULL,NULL,NULL,'',NULL);
INSERT INTO "prediction" VALUES(3,3,'monosized','{"cloud_fraction": 0.25, "compaction": "loose", "container": "periodic", "local_damping": 0.7, "moment_damping": false, "nominal_overlap": 0.002, "restitution": 0.5, "steps_per_collision": 10.0, "wall_friction": null}',1,6.36786886922265815691e-01,6.03904719485075084685e-04,4.02758874594354079196e-03,NULL,'done','2026-12-01 04:05:28.485462','2026-12-01 04:05:28.485453',0,1.0,NULL,NULL,NULL,'',NULL);
INSERT INTO "prediction" VALUES(4,1,'monosized','',NULL,NULL,NULL,NULL,NULL,'queued','2026-02-03 04:05:06.000789',NULL,0,0.0,NULL,NULL,NULL,'','{"leave_out": null, "pan_factor": 1.0, "rule": "log_mean", "seeds": 4, "settings": []}');
CREATE TABLE prediction_calibration (
	prediction_id INTEGER NOT NULL, 
	calibration_id INTEGER NOT NULL, 
	CONSTRAINT pk_prediction_calibration PRIMARY KEY (prediction_id, calibration_id), 
	CONSTRAINT fk_prediction_calibration_calibration_id_calibration FOREIGN KEY(calibration_id) REFERENCES calibration (id), 
	CONSTRAINT fk_prediction_calibration_prediction_id_prediction FOREIGN KEY(prediction_id) REFERENCES prediction (id)
);
INSERT INTO "prediction_calibration" VALUES(1,1);
INSERT INTO "prediction_calibration" VALUES(1,2);
INSERT INTO "prediction_calibration" VALUES(2,1);
INSERT INTO "prediction_calibration" VALUES(2,3);
INSERT INTO "prediction_calibration" VALUES(3,2);
INSERT INTO "prediction_calibration" VALUES(3,3);
CREATE TABLE prediction_run (
	prediction_id INTEGER NOT NULL, 
	specimen_hash VARCHAR(64) NOT NULL, 
	CONSTRAINT pk_prediction_run PRIMARY KEY (prediction_id, specimen_hash), 
	CONSTRAINT fk_prediction_run_prediction_id_prediction FOREIGN KEY(prediction_id) REFERENCES prediction (id), 
	CONSTRAINT fk_prediction_run_specimen_hash_run FOREIGN KEY(specimen_hash) REFERENCES run (specimen_hash)
);
INSERT INTO "prediction_run" VALUES(1,'70db226a8d66cb852f5beac6d608467cdf423fe84736a0f3cc3a726a2f643ada');
INSERT INTO "prediction_run" VALUES(1,'b625dc94f1e69e52a8102f8b6ade1b3dca990012f4ade742ab315fd5af98e61c');
INSERT INTO "prediction_run" VALUES(1,'e1691898a09d7452389f6804ccc47dad6bf4df1630a83bdd79826316033eef94');
INSERT INTO "prediction_run" VALUES(1,'fda60c2e9eb86599753dd1c926e610f8aeb9c1e84de463e6f4deaef5e1da65c5');
INSERT INTO "prediction_run" VALUES(2,'847291008cc285338d0b5c0264321ddcaa1986741d7ced25cbca1728f60e1ba3');
INSERT INTO "prediction_run" VALUES(2,'88552b1cd0549b2261bb20778c7bd5653c952af00236876bc546fa1196a31f74');
INSERT INTO "prediction_run" VALUES(2,'c0455c2f70d7676093505615daa4de03726f14dd07b9367d80b3dc156dcae04b');
INSERT INTO "prediction_run" VALUES(2,'cd90fc3a8d1fb15c57b2ec543781cb54f8b67e37269ee4a7136af466c14a0055');
INSERT INTO "prediction_run" VALUES(3,'14be0d4a939c92159482f3f3431ebcc0a269948fdb9be98db3ee4718a66ddad1');
INSERT INTO "prediction_run" VALUES(3,'36c7a73ba9f357098610c80f0044e9310d4d8bdb97f968c961c5ac6b564b38e2');
INSERT INTO "prediction_run" VALUES(3,'a04ecd86531bd60f8b254379537ac8024f4f071e656daee19b2f625bcf66813b');
INSERT INTO "prediction_run" VALUES(3,'dfd8a835d788db62542bd8654d3408dd60b8c393b7c9233acc0918a1f6e4f909');
CREATE TABLE "run" (
	specimen_hash VARCHAR(64) NOT NULL, 
	specimen TEXT NOT NULL, 
	engine_version INTEGER NOT NULL, 
	numba_version TEXT, 
	processor TEXT, 
	seed INTEGER NOT NULL, 
	spheres INTEGER NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	packing_density DOUBLE, 
	coordination_number DOUBLE, 
	height DOUBLE, 
	slab_shares TEXT, 
	largest_overlap DOUBLE, 
	rest TEXT, 
	steps INTEGER, 
	seconds DOUBLE, 
	warnings TEXT, 
	claimed_by TEXT, 
	heartbeat DATETIME, 
	error TEXT, 
	created_at DATETIME NOT NULL, 
	finished_at DATETIME, 
	repose_angle_deg DOUBLE, 
	CONSTRAINT pk_run PRIMARY KEY (specimen_hash), 
	CONSTRAINT ck_run_state CHECK (state IN ('queued', 'running', 'done', 'failed', 'cancelled')), 
	CONSTRAINT ck_run_packing_density CHECK (packing_density > 0 AND packing_density < 1), 
	CONSTRAINT ck_run_specimen_hash CHECK (length(specimen_hash) = 64), 
	CONSTRAINT ck_run_effort CHECK (steps >= 0 AND seconds >= 0), 
	CONSTRAINT ck_run_repose_angle CHECK (repose_angle_deg BETWEEN 0 AND 90), 
	CONSTRAINT ck_run_done_has_result CHECK (state <> 'done' OR packing_density IS NOT NULL OR repose_angle_deg IS NOT NULL)
);
INSERT INTO "run" VALUES('9106ed140c37d4f8e17bdc77e8f25246840c8cda79d77701cb86c9b8f1631c9c','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.2},"seed":1,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.2,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',1,2500,'done',5.72538332728114385261e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.412343','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('97bcf5a716b37f3acfcc345418f0bdbc946c54d87327ea18fda9da78c06e3ea6','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.2},"seed":2,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.2,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',2,2500,'done',5.74010119400240825804e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.413382','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('3c2daf05156e21819867dfb914a6ccbae3be26bf0c177265ec4fdd7be0e7b030','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.2},"seed":3,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.2,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',3,2500,'done',5.72652078926966456862e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.413977','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('5e8780095b0b0323878f8c2e9f1b495e7b3ee6e58a508d7484fdcabf328afb09','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.2},"seed":4,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.2,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',4,2500,'done',5.72622184432973524437e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.414403','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('be520a7024b26b516554e36bbcc76574669d23e234ec020f44dcc17fd2b45b9b','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.1},"seed":1,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.1,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',1,2500,'done',5.84600455841740807017e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.417126','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('f0cdbda5eb4dfcb72cb21e74da193a2ddcf49ff1b0e3bff0f063b626f4fd6b64','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.1},"seed":2,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.1,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',2,2500,'done',5.84448750009484929712e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.417684','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('0bc446e29ec975cb6b99c7bb6261ded0a72a6bec8fd674d57e39c2d8f7a7c2fd','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.1},"seed":3,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.1,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',3,2500,'done',5.84811572422548220373e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.418163','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('73dfa520d0ca6f1c2654ebf986c36a8119f12e91f03a203fc838ced17eacdc65','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.1},"seed":4,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.1,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',4,2500,'done',5.84547029689167496613e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.418582','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('0b27bdf25f2b4178c72e43d53765b6bb60df93dea6d0f63228c9618770d11838','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.05},"seed":1,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.05,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',1,2500,'done',5.95879841085121375598e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.420978','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('4aa7dfbdb9f26f9a819a66517412342a95c41581433689197e4072fe9794d22e','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.05},"seed":2,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.05,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',2,2500,'done',5.95444829030390532231e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.421511','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('8582a4f0b3dcbd3cbf2b5d15157a885954bb7edfc71a59e0fe249bfa03333368','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.05},"seed":3,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.05,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',3,2500,'done',5.95969234605404296623e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.421987','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('91995be5ac75f1c3b2da0ebe00c2f61742ea6b5409a95bdd34fb7c7f341a7432','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.05},"seed":4,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.05,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',4,2500,'done',5.95357401165587662994e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.422393','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('565639ee1d5f9e4ad89f62c76b0213312e38f1b54d42b5ee19ff0fb436645e61','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.02},"seed":1,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.02,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',1,2500,'done',6.0814610556731174551e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.425134','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('2b0f43df3793f1565c901cf0e035491082dc902c42f2b8323fc33928b247ed6a','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.02},"seed":2,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.02,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',2,2500,'done',6.08454213604255444991e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.425825','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('6989d974da5a6cbd51e6a16c60f44a3d144face341ea856e7bfc47a93f192e35','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.02},"seed":3,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.02,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',3,2500,'done',6.08202936949074346451e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.426304','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('951fcf4ae7dbb9484c0144a39d14d0cedf56be9bbcebbb73ec53df6357ef4306','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.02},"seed":4,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.02,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',4,2500,'done',6.0956391662750053495e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.426712','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('dcd7c8ed93c88b769f5f692d10d8d915decbbdfd913e321bdf52c6928bd7e064','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.0},"seed":1,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.0,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',1,2500,'done',6.40747990184404869751e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.429167','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('28aba6f1bdb952157fe5e8740580d1a12920c18ff4fa4d8ae5b8b02f01a07922','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.0},"seed":2,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.0,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',2,2500,'done',0.640790647113647,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.429678','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('f7fe06b0270d179f125566804cc92be86ed93a292672cb137c755f84e6ac1a8a','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.0},"seed":3,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.0,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',3,2500,'done',0.639842088053199,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.430139','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('28a014bbfe8ed8a6943261a112ae28dba9a756b7af1871d81151bacf4cb61576','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.0},"seed":4,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.0,"rolling":0.0}],"width":10.0}',1,'0.65.1','znver4',4,2500,'done',6.39982511317586211241e-01,5.0,20.0,'[1.0]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.430531','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('e1691898a09d7452389f6804ccc47dad6bf4df1630a83bdd79826316033eef94','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":1,"species":[{"count":404,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":2097,"density":1.0,"diameter":0.5774,"friction":0.01519,"rolling":0.0}],"width":6.556}',1,'0.65.1','znver4',1,2501,'done',6.32607953903021380526e-01,5.0,20.0,'[0.5002029705686352, 0.49979702943136484]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.461369','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('70db226a8d66cb852f5beac6d608467cdf423fe84736a0f3cc3a726a2f643ada','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":2,"species":[{"count":404,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":2097,"density":1.0,"diameter":0.5774,"friction":0.01519,"rolling":0.0}],"width":6.556}',1,'0.65.1','znver4',2,2501,'done',6.3400415434417056737e-01,5.0,20.0,'[0.5002029705686352, 0.49979702943136484]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.461975','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('b625dc94f1e69e52a8102f8b6ade1b3dca990012f4ade742ab315fd5af98e61c','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":3,"species":[{"count":404,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":2097,"density":1.0,"diameter":0.5774,"friction":0.01519,"rolling":0.0}],"width":6.556}',1,'0.65.1','znver4',3,2501,'done',6.33563128400106867488e-01,5.0,20.0,'[0.5002029705686352, 0.49979702943136484]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.462464','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('fda60c2e9eb86599753dd1c926e610f8aeb9c1e84de463e6f4deaef5e1da65c5','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":4,"species":[{"count":404,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":2097,"density":1.0,"diameter":0.5774,"friction":0.01519,"rolling":0.0}],"width":6.556}',1,'0.65.1','znver4',4,2501,'done',6.33701474515731888459e-01,5.0,20.0,'[0.5002029705686352, 0.49979702943136484]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.462914','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('c0455c2f70d7676093505615daa4de03726f14dd07b9367d80b3dc156dcae04b','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.03736},"seed":1,"species":[{"count":180,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":7442,"density":1.0,"diameter":0.2887,"friction":0.1102,"rolling":0.0}],"width":5.0}',1,'0.65.1','znver4',1,7622,'done',6.36501610863022926345e-01,5.0,20.0,'[0.5012908768627422, 0.4987091231372579]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.463347','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('88552b1cd0549b2261bb20778c7bd5653c952af00236876bc546fa1196a31f74','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.03736},"seed":2,"species":[{"count":180,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":7442,"density":1.0,"diameter":0.2887,"friction":0.1102,"rolling":0.0}],"width":5.0}',1,'0.65.1','znver4',2,7622,'done',6.36071905648701863e-01,5.0,20.0,'[0.5012908768627422, 0.4987091231372579]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.463926','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('cd90fc3a8d1fb15c57b2ec543781cb54f8b67e37269ee4a7136af466c14a0055','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.03736},"seed":3,"species":[{"count":180,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":7442,"density":1.0,"diameter":0.2887,"friction":0.1102,"rolling":0.0}],"width":5.0}',1,'0.65.1','znver4',3,7622,'done',6.36302353727119629489e-01,5.0,20.0,'[0.5012908768627422, 0.4987091231372579]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.464377','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('847291008cc285338d0b5c0264321ddcaa1986741d7ced25cbca1728f60e1ba3','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.03736},"seed":4,"species":[{"count":180,"density":1.0,"diameter":1.0,"friction":0.03736,"rolling":0.0},{"count":7442,"density":1.0,"diameter":0.2887,"friction":0.1102,"rolling":0.0}],"width":5.0}',1,'0.65.1','znver4',4,7622,'done',6.35988366878006750049e-01,5.0,20.0,'[0.5012908768627422, 0.4987091231372579]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.464802','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('a04ecd86531bd60f8b254379537ac8024f4f071e656daee19b2f625bcf66813b','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":1,"species":[{"count":278,"density":1.0,"diameter":1.0,"friction":0.01519,"rolling":0.0},{"count":2223,"density":1.0,"diameter":0.5,"friction":0.1102,"rolling":0.0}],"width":5.788}',1,'0.65.1','znver4',1,2501,'done',6.37290462225509224403e-01,5.0,20.0,'[0.500112435349674, 0.4998875646503261]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.465226','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('14be0d4a939c92159482f3f3431ebcc0a269948fdb9be98db3ee4718a66ddad1','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":2,"species":[{"count":278,"density":1.0,"diameter":1.0,"friction":0.01519,"rolling":0.0},{"count":2223,"density":1.0,"diameter":0.5,"friction":0.1102,"rolling":0.0}],"width":5.788}',1,'0.65.1','znver4',2,2501,'done',6.36348571588365219398e-01,5.0,20.0,'[0.500112435349674, 0.4998875646503261]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.465640','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('36c7a73ba9f357098610c80f0044e9310d4d8bdb97f968c961c5ac6b564b38e2','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":3,"species":[{"count":278,"density":1.0,"diameter":1.0,"friction":0.01519,"rolling":0.0},{"count":2223,"density":1.0,"diameter":0.5,"friction":0.1102,"rolling":0.0}],"width":5.788}',1,'0.65.1','znver4',3,2501,'done',6.36500166952259638364e-01,5.0,20.0,'[0.500112435349674, 0.4998875646503261]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.466056','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('dfd8a835d788db62542bd8654d3408dd60b8c393b7c9233acc0918a1f6e4f909','{"engine_version":1,"height":null,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic","local_damping":0.7,"moment_damping":false,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,"wall_friction":0.01519},"seed":4,"species":[{"count":278,"density":1.0,"diameter":1.0,"friction":0.01519,"rolling":0.0},{"count":2223,"density":1.0,"diameter":0.5,"friction":0.1102,"rolling":0.0}],"width":5.788}',1,'0.65.1','znver4',4,2501,'done',6.370083469229291806e-01,5.0,20.0,'[0.500112435349674, 0.4998875646503261]',0.005,'still',1000,1.0,NULL,NULL,NULL,NULL,'2026-12-01 04:05:28.466423','2026-02-03 04:05:06.000789',NULL);
INSERT INTO "run" VALUES('ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff','{}',1,NULL,NULL,7,3,'failed',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,'the bed still moves','2026-02-03 04:05:06.000789',NULL,NULL);
CREATE TABLE run_state (
	specimen_hash VARCHAR(64) NOT NULL, 
	steps INTEGER NOT NULL, 
	archive BLOB NOT NULL, 
	CONSTRAINT pk_run_state PRIMARY KEY (specimen_hash), 
	CONSTRAINT fk_run_state_specimen_hash_run FOREIGN KEY(specimen_hash) REFERENCES run (specimen_hash) ON DELETE CASCADE
);
INSERT INTO "run_state" VALUES('0b27bdf25f2b4178c72e43d53765b6bb60df93dea6d0f63228c9618770d11838',1000,X'504B03042D0000000800000021005415A966FFFFFFFFFFFFFFFF09001400706C6163652E6E707901001000E00000000000000066000000000000009BEC17EA1B10C9C850C650AD9E925A9C5CA46EA5A06E9366A1AEA3A09E965F54529498179F5F94920A12774BCC294E058A17672416A402F91AC63A0A269A3A0AB50A64032E0614F0C11ECA7080501C505A004A8B406909282D03A515A0B412945681D26A0E00504B03042D00000008000000210025BA731BFFFFFFFFFFFFFFFF0B001400737065636965732E6E707901001000830000000000000047000000000000009BEC17EA1B10C9C850C650AD9E925A9C5CA46EA5A05E536AA8AEA3A09E965F54529498179F5F94920A12774BCC294E058A17672416A402F91AC63A9A3A0AB50A14002E06060600504B01022D032D0000000800000021005415A96666000000E0000000090000000000000000000000800100000000706C6163652E6E7079504B01022D032D00000008000000210025BA731B47000000830000000B00000000000000000000008001A1000000737065636965732E6E7079504B0506000000000200020070000000250100000000');
CREATE TABLE sieve_analysis (
	id INTEGER NOT NULL, 
	aggregate_id INTEGER NOT NULL, 
	kind VARCHAR(16) NOT NULL, 
	sample_mass_g DOUBLE, 
	pan_lower_mm DOUBLE, 
	standard TEXT, 
	date DATE, 
	raw_text TEXT, 
	created_at DATETIME NOT NULL, version INTEGER DEFAULT '1' NOT NULL, finest_mm DOUBLE, coarsest_mm DOUBLE, log_mean_mm DOUBLE, 
	CONSTRAINT pk_sieve_analysis PRIMARY KEY (id), 
	CONSTRAINT ck_sieve_analysis_kind CHECK (kind IN ('retained_g', 'retained_percent', 'passing_percent')), 
	CONSTRAINT ck_sieve_analysis_pan_lower CHECK (pan_lower_mm > 0), 
	CONSTRAINT ck_sieve_analysis_sample_mass CHECK (sample_mass_g > 0), 
	CONSTRAINT fk_sieve_analysis_aggregate_id_aggregate FOREIGN KEY(aggregate_id) REFERENCES aggregate (id)
);
INSERT INTO "sieve_analysis" VALUES(1,1,'passing_percent',NULL,NULL,NULL,NULL,'60.96	100
40.64	0','2026-12-01 04:05:28.367747',1,40.64,60.96,4.97736315733541800909e+01);
INSERT INTO "sieve_analysis" VALUES(2,2,'passing_percent',NULL,NULL,NULL,NULL,'40.64	100
20.32	0','2026-12-01 04:05:28.367750',1,20.32,40.64,2.87368195874212872809e+01);
INSERT INTO "sieve_analysis" VALUES(3,3,'passing_percent',NULL,NULL,NULL,NULL,'20.32	100
10.16	0','2026-12-01 04:05:28.367751',1,10.16,20.32,1.43684097937106436404e+01);
CREATE TABLE sieve_result (
	sieve_analysis_id INTEGER NOT NULL, 
	position INTEGER NOT NULL, 
	aperture_mm DOUBLE, 
	retained_g DOUBLE, 
	retained_percent DOUBLE, 
	passing_percent DOUBLE, 
	raw_text TEXT NOT NULL, 
	CONSTRAINT pk_sieve_result PRIMARY KEY (sieve_analysis_id, position), 
	CONSTRAINT ck_sieve_result_one_value CHECK (CASE WHEN retained_g IS NULL THEN 0 ELSE 1 END + CASE WHEN retained_percent IS NULL THEN 0 ELSE 1 END + CASE WHEN passing_percent IS NULL THEN 0 ELSE 1 END = 1), 
	CONSTRAINT ck_sieve_result_aperture CHECK (aperture_mm > 0), 
	CONSTRAINT ck_sieve_result_passing_percent CHECK (passing_percent BETWEEN 0 AND 100), 
	CONSTRAINT ck_sieve_result_retained_g CHECK (retained_g >= 0), 
	CONSTRAINT ck_sieve_result_retained_percent CHECK (retained_percent BETWEEN 0 AND 100), 
	CONSTRAINT fk_sieve_result_sieve_analysis_id_sieve_analysis FOREIGN KEY(sieve_analysis_id) REFERENCES sieve_analysis (id), 
	CONSTRAINT uq_sieve_result_sieve_analysis_id_aperture_mm UNIQUE (sieve_analysis_id, aperture_mm)
);
INSERT INTO "sieve_result" VALUES(1,0,60.96,NULL,NULL,100.0,'60.96	100');
INSERT INTO "sieve_result" VALUES(1,1,40.64,NULL,NULL,0.0,'40.64	0');
INSERT INTO "sieve_result" VALUES(2,0,40.64,NULL,NULL,100.0,'40.64	100');
INSERT INTO "sieve_result" VALUES(2,1,20.32,NULL,NULL,0.0,'20.32	0');
INSERT INTO "sieve_result" VALUES(3,0,20.32,NULL,NULL,100.0,'20.32	100');
INSERT INTO "sieve_result" VALUES(3,1,10.16,NULL,NULL,0.0,'10.16	0');
CREATE TABLE sweep (
	id INTEGER NOT NULL, 
	method VARCHAR(32) NOT NULL, 
	asked TEXT, 
	wished_error DOUBLE NOT NULL, 
	most_specimens INTEGER NOT NULL, 
	engine_version INTEGER, 
	packing_density DOUBLE, 
	standard_error DOUBLE, 
	input_error DOUBLE, 
	curve TEXT, 
	warnings TEXT, 
	variant VARCHAR(64) DEFAULT '' NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	requested_at DATETIME NOT NULL, 
	finished_at DATETIME, 
	priority INTEGER NOT NULL, 
	progress DOUBLE NOT NULL, 
	message TEXT, 
	claimed_by TEXT, 
	heartbeat DATETIME, 
	CONSTRAINT pk_sweep PRIMARY KEY (id), 
	CONSTRAINT ck_sweep_state CHECK (state IN ('queued', 'running', 'done', 'failed', 'cancelled')), 
	CONSTRAINT ck_sweep_packing_density CHECK (packing_density > 0 AND packing_density < 1), 
	CONSTRAINT ck_sweep_errors CHECK (standard_error >= 0 AND input_error >= 0), 
	CONSTRAINT ck_sweep_wished CHECK (wished_error > 0 AND most_specimens > 0), 
	CONSTRAINT ck_sweep_done_has_result CHECK (state <> 'done' OR packing_density IS NOT NULL), 
	CONSTRAINT ck_sweep_progress CHECK (progress BETWEEN 0 AND 1)
);
INSERT INTO "sweep" VALUES(1,'monosized','{"leave_out": null, "pan_factor": 1.0, "rule": "log_mean", "seeds": 4, "settings": []}',0.001,12,1,0.64,0.001,0.004,NULL,NULL,'','done','2026-02-03 04:05:06.000789','2026-02-03 04:05:06.000789',0,1.0,NULL,NULL,NULL);
CREATE TABLE sweep_calibration (
	sweep_id INTEGER NOT NULL, 
	calibration_id INTEGER NOT NULL, 
	CONSTRAINT pk_sweep_calibration PRIMARY KEY (sweep_id, calibration_id), 
	CONSTRAINT fk_sweep_calibration_sweep_id_sweep FOREIGN KEY(sweep_id) REFERENCES sweep (id), 
	CONSTRAINT fk_sweep_calibration_calibration_id_calibration FOREIGN KEY(calibration_id) REFERENCES calibration (id)
);
INSERT INTO "sweep_calibration" VALUES(1,1);
INSERT INTO "sweep_calibration" VALUES(1,2);
CREATE TABLE sweep_component (
	sweep_id INTEGER NOT NULL, 
	position INTEGER NOT NULL, 
	aggregate_id INTEGER NOT NULL, 
	densest_share DOUBLE, 
	next_share DOUBLE, 
	CONSTRAINT pk_sweep_component PRIMARY KEY (sweep_id, position), 
	CONSTRAINT ck_sweep_component_densest_share CHECK (densest_share BETWEEN 0 AND 1), 
	CONSTRAINT ck_sweep_component_next_share CHECK (next_share BETWEEN 0 AND 1), 
	CONSTRAINT fk_sweep_component_sweep_id_sweep FOREIGN KEY(sweep_id) REFERENCES sweep (id), 
	CONSTRAINT fk_sweep_component_aggregate_id_aggregate FOREIGN KEY(aggregate_id) REFERENCES aggregate (id)
);
INSERT INTO "sweep_component" VALUES(1,0,1,0.5,0.25);
INSERT INTO "sweep_component" VALUES(1,1,2,0.5,0.75);
CREATE TABLE sweep_run (
	sweep_id INTEGER NOT NULL, 
	specimen_hash VARCHAR(64) NOT NULL, 
	CONSTRAINT pk_sweep_run PRIMARY KEY (sweep_id, specimen_hash), 
	CONSTRAINT fk_sweep_run_sweep_id_sweep FOREIGN KEY(sweep_id) REFERENCES sweep (id), 
	CONSTRAINT fk_sweep_run_specimen_hash_run FOREIGN KEY(specimen_hash) REFERENCES run (specimen_hash)
);
INSERT INTO "sweep_run" VALUES(1,'0b27bdf25f2b4178c72e43d53765b6bb60df93dea6d0f63228c9618770d11838');
CREATE INDEX ix_mixture_component_aggregate_id ON mixture_component (aggregate_id);
CREATE INDEX ix_prediction_state ON prediction (state);
CREATE INDEX ix_sieve_analysis_aggregate_id ON sieve_analysis (aggregate_id);
CREATE INDEX ix_prediction_run_specimen_hash ON prediction_run (specimen_hash);
CREATE INDEX ix_calibration_run_specimen_hash ON calibration_run (specimen_hash);
CREATE INDEX ix_prediction_calibration_calibration_id ON prediction_calibration (calibration_id);
CREATE INDEX ix_correction_table_name_row_key ON correction (table_name, row_key);
CREATE INDEX ix_mixture_component_shares ON mixture_component (mixture_id, aggregate_id, solid_volume_share);
CREATE INDEX ix_run_list ON run (finished_at, specimen_hash, state, spheres, seed, packing_density, coordination_number, steps, seconds, rest, engine_version);
CREATE INDEX ix_calibration_aggregate_id ON calibration (aggregate_id);
CREATE INDEX ix_calibration_state ON calibration (state);
CREATE INDEX ix_packing_test_aggregate_id ON packing_test (aggregate_id);
CREATE INDEX ix_packing_test_mixture_id ON packing_test (mixture_id);
CREATE INDEX ix_prediction_newest ON prediction (mixture_id, method, variant, requested_at, id, state);
CREATE VIEW outdated_calibrations AS
SELECT c.id AS calibration_id, a.id AS aggregate_id, a.name AS aggregate
FROM calibration c JOIN aggregate a ON a.id = c.aggregate_id
WHERE c.sieve_analysis_id <> (SELECT max(x.id) FROM sieve_analysis x WHERE x.aggregate_id = c.aggregate_id)
    OR c.packing_test_id <> (SELECT max(x.id) FROM packing_test x WHERE x.aggregate_id = c.aggregate_id)
    OR EXISTS (
        SELECT 1 FROM correction k
        WHERE k.corrected_at > c.requested_at AND (
    k.table_name = 'aggregate' AND k.row_key = CAST(c.aggregate_id AS TEXT) AND (
        c.measured_angle_deg IS NOT NULL AND k.column_name IN ('repose_angle_deg', 'wall_angle_deg')
        OR c.packing_test_id IS NOT NULL AND k.column_name NOT IN ('repose_angle_deg', 'wall_angle_deg')
    )
    OR k.table_name = 'packing_test' AND k.row_key = CAST(c.packing_test_id AS TEXT)
    OR k.table_name = 'sieve_analysis' AND k.row_key = CAST(c.sieve_analysis_id AS TEXT)
    OR k.table_name = 'sieve_result' AND k.row_key IN (
        SELECT CAST(r.sieve_analysis_id AS TEXT) || '/' || CAST(r.position AS TEXT)
        FROM sieve_result r WHERE r.sieve_analysis_id = c.sieve_analysis_id
    )
) AND k.column_name IN ('repose_angle_deg', 'wall_angle_deg', 'particle_density_kg_m3', 'density_basis', 'water_absorption_percent', 'kind', 'sample_mass_g', 'pan_lower_mm', 'aperture_mm', 'retained_g', 'retained_percent', 'passing_percent', 'compaction', 'bulk_density_kg_m3', 'voids_percent', 'packing_density', 'repeats', 'standard_deviation', 'solid_volume_share')
            AND NOT EXISTS (
                SELECT 1 FROM correction e WHERE e.table_name = k.table_name AND e.row_key = k.row_key AND e.column_name = k.column_name AND e.id < k.id AND e.corrected_at > c.requested_at
            )
            AND coalesce(k.old_value, '') <> coalesce(
                (SELECT n.new_value FROM correction n WHERE n.table_name = k.table_name AND n.row_key = k.row_key AND n.column_name = k.column_name ORDER BY n.id DESC LIMIT 1), ''
            )
    );
CREATE VIEW current_aggregates AS
SELECT
    a.id AS aggregate_id, a.name, a.delivery, a.source, a.shape,
    CASE a.density_basis
        WHEN 'oven_dry' THEN a.particle_density_kg_m3
        WHEN 'ssd' THEN a.particle_density_kg_m3 / (1.0 + a.water_absorption_percent / 100.0)
        WHEN 'apparent' THEN 1.0 / (1.0 / a.particle_density_kg_m3 + a.water_absorption_percent / 100.0 / 997.5)
    END AS oven_dry_density_kg_m3,
    s.id AS sieve_analysis_id, s.finest_mm, s.coarsest_mm, s.log_mean_mm, t.id AS packing_test_id, t.compaction,
    CASE
        WHEN t.packing_density IS NOT NULL THEN t.packing_density
        WHEN t.voids_percent IS NOT NULL THEN 1.0 - t.voids_percent / 100.0
        ELSE t.bulk_density_kg_m3 / (CASE a.density_basis
        WHEN 'oven_dry' THEN a.particle_density_kg_m3
        WHEN 'ssd' THEN a.particle_density_kg_m3 / (1.0 + a.water_absorption_percent / 100.0)
        WHEN 'apparent' THEN 1.0 / (1.0 / a.particle_density_kg_m3 + a.water_absorption_percent / 100.0 / 997.5)
    END)
    END AS measured_packing_density,
    c.id AS calibration_id, c.state, c.method, c.diameter_rule, c.diameter_mm, c.friction, c.friction_low,
    c.friction_high, c.rolling_friction, c.rolling_friction_low, c.rolling_friction_high, c.engine_version, c.message,
    a.created_at
FROM aggregate a
LEFT JOIN sieve_analysis s ON s.id = (SELECT max(x.id) FROM sieve_analysis x WHERE x.aggregate_id = a.id)
LEFT JOIN packing_test t ON t.id = (SELECT max(x.id) FROM packing_test x WHERE x.aggregate_id = a.id)
LEFT JOIN calibration c ON c.id = (
    SELECT x.id FROM calibration x
    WHERE x.aggregate_id = a.id AND x.variant = '' AND x.state IN ('done', 'failed')
        AND x.id NOT IN (SELECT calibration_id FROM outdated_calibrations)
    ORDER BY x.requested_at DESC, x.id DESC LIMIT 1
)
WHERE a.id = (SELECT max(x.id) FROM aggregate x WHERE x.name = a.name);
CREATE VIEW predicted_vs_measured AS
SELECT pair.mixture_id, pair.mixture, pair.prediction_id,
    CASE WHEN pair.state = 'done' AND (pair.outdated IS NOT NULL OR pair.corrected) THEN 'outdated' ELSE pair.state END
        AS state,
    pair.method, pair.engine_version, pair.predicted, pair.standard_error, pair.input_error, pair.packing_test_id,
    pair.compaction, pair.measured, pair.message, pair.warnings, pair.outdated, pair.requested_at, pair.finished_at,
    pair.predicted - pair.measured AS difference
FROM (
    SELECT
        m.id AS mixture_id, m.name AS mixture, p.id AS prediction_id, coalesce(p.state, 'open') AS state,
        p.method, p.engine_version, p.packing_density AS predicted, p.standard_error, p.input_error,
        t.id AS packing_test_id, t.compaction,
        CASE
        WHEN t.packing_density IS NOT NULL THEN t.packing_density
        WHEN t.voids_percent IS NOT NULL THEN 1.0 - t.voids_percent / 100.0
        ELSE t.bulk_density_kg_m3 / (
            SELECT CASE WHEN count(*) = count(CASE a.density_basis
        WHEN 'oven_dry' THEN a.particle_density_kg_m3
        WHEN 'ssd' THEN a.particle_density_kg_m3 / (1.0 + a.water_absorption_percent / 100.0)
        WHEN 'apparent' THEN 1.0 / (1.0 / a.particle_density_kg_m3 + a.water_absorption_percent / 100.0 / 997.5)
    END)
                THEN sum(k.solid_volume_share * (CASE a.density_basis
        WHEN 'oven_dry' THEN a.particle_density_kg_m3
        WHEN 'ssd' THEN a.particle_density_kg_m3 / (1.0 + a.water_absorption_percent / 100.0)
        WHEN 'apparent' THEN 1.0 / (1.0 / a.particle_density_kg_m3 + a.water_absorption_percent / 100.0 / 997.5)
    END)) / sum(k.solid_volume_share) END
            FROM mixture_component k JOIN aggregate a ON a.id = k.aggregate_id WHERE k.mixture_id = m.id
        )
    END AS measured,
        p.message, p.warnings, (
            SELECT group_concat(o.aggregate, ', ') FROM (
                SELECT o.aggregate FROM prediction_calibration l
                JOIN outdated_calibrations o ON o.calibration_id = l.calibration_id
                WHERE l.prediction_id = p.id ORDER BY l.calibration_id
            ) o
        ) AS outdated,
        m.version > 1 AND EXISTS (
        SELECT 1 FROM correction k
        WHERE k.corrected_at > p.requested_at AND (
    k.table_name = 'mixture_component' AND k.row_key IN (
        SELECT CAST(r.mixture_id AS TEXT) || '/' || CAST(r.position AS TEXT)
        FROM mixture_component r WHERE r.mixture_id = m.id
    )
) AND k.column_name IN ('repose_angle_deg', 'wall_angle_deg', 'particle_density_kg_m3', 'density_basis', 'water_absorption_percent', 'kind', 'sample_mass_g', 'pan_lower_mm', 'aperture_mm', 'retained_g', 'retained_percent', 'passing_percent', 'compaction', 'bulk_density_kg_m3', 'voids_percent', 'packing_density', 'repeats', 'standard_deviation', 'solid_volume_share')
            AND NOT EXISTS (
                SELECT 1 FROM correction e WHERE e.table_name = k.table_name AND e.row_key = k.row_key AND e.column_name = k.column_name AND e.id < k.id AND e.corrected_at > p.requested_at
            )
            AND coalesce(k.old_value, '') <> coalesce(
                (SELECT n.new_value FROM correction n WHERE n.table_name = k.table_name AND n.row_key = k.row_key AND n.column_name = k.column_name ORDER BY n.id DESC LIMIT 1), ''
            )
    )
            OR p.method IN ('static', 'drop_and_roll', 'ordered') AND EXISTS (
            SELECT 1 FROM mixture_component y JOIN sieve_analysis s
                ON s.id = (SELECT max(x.id) FROM sieve_analysis x WHERE x.aggregate_id = y.aggregate_id)
            WHERE y.mixture_id = m.id
                AND (s.created_at > p.requested_at OR s.version > 1 AND EXISTS (
        SELECT 1 FROM correction k
        WHERE k.corrected_at > p.requested_at AND (
    k.table_name = 'sieve_analysis' AND k.row_key = CAST(s.id AS TEXT)
    OR k.table_name = 'sieve_result' AND k.row_key IN (
        SELECT CAST(r.sieve_analysis_id AS TEXT) || '/' || CAST(r.position AS TEXT)
        FROM sieve_result r WHERE r.sieve_analysis_id = s.id
    )
) AND k.column_name IN ('repose_angle_deg', 'wall_angle_deg', 'particle_density_kg_m3', 'density_basis', 'water_absorption_percent', 'kind', 'sample_mass_g', 'pan_lower_mm', 'aperture_mm', 'retained_g', 'retained_percent', 'passing_percent', 'compaction', 'bulk_density_kg_m3', 'voids_percent', 'packing_density', 'repeats', 'standard_deviation', 'solid_volume_share')
            AND NOT EXISTS (
                SELECT 1 FROM correction e WHERE e.table_name = k.table_name AND e.row_key = k.row_key AND e.column_name = k.column_name AND e.id < k.id AND e.corrected_at > p.requested_at
            )
            AND coalesce(k.old_value, '') <> coalesce(
                (SELECT n.new_value FROM correction n WHERE n.table_name = k.table_name AND n.row_key = k.row_key AND n.column_name = k.column_name ORDER BY n.id DESC LIMIT 1), ''
            )
    ))
        ) AS corrected,
        p.requested_at, p.finished_at
    FROM mixture m
    LEFT JOIN prediction p ON p.mixture_id = m.id AND p.variant = '' AND p.state IN ('done', 'failed')
        AND NOT EXISTS (
            SELECT 1 FROM prediction x
            WHERE x.mixture_id = p.mixture_id AND x.method = p.method AND x.variant = ''
                AND x.state IN ('done', 'failed') AND (x.requested_at, x.id) > (p.requested_at, p.id)
        )
    LEFT JOIN packing_test t ON t.id = (SELECT max(x.id) FROM packing_test x WHERE x.mixture_id = m.id)
) pair;
CREATE INDEX ix_comparison_prediction_id ON comparison (prediction_id);
CREATE INDEX ix_sweep_state ON sweep (state);
CREATE INDEX ix_sweep_component_aggregate_id ON sweep_component (aggregate_id);
CREATE INDEX ix_sweep_run_specimen_hash ON sweep_run (specimen_hash);
CREATE INDEX ix_sweep_calibration_calibration_id ON sweep_calibration (calibration_id);
CREATE INDEX ix_run_newest_engine ON run (engine_version) WHERE engine_version > 0;
CREATE INDEX ix_comparison_spread ON comparison (method, engine_version, simulated, compaction, difference);
COMMIT;
