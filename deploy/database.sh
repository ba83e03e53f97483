#!/bin/sh
# Runs once, when the database is created: makes the service's role, which owns its database and is
# no superuser. From then on the superuser has no password, so that only a process in the database's
# own container can be it.
set -eu
psql --no-psqlrc --quiet --no-password --username postgres --dbname postgres \
    --set ON_ERROR_STOP=1 --set password="$POSTGRES_PASSWORD" <<'SQL'
CREATE ROLE foldback LOGIN NOSUPERUSER NOCREATEDB NOCREATEROLE PASSWORD :'password';
CREATE DATABASE foldback OWNER foldback;
REVOKE CONNECT ON DATABASE foldback FROM PUBLIC;
ALTER ROLE postgres PASSWORD NULL;
SQL
