#!/bin/sh
# Creates a signed apt repository for Debian 12, or adds packages to one:
#   docker/apt_repository.sh DIRECTORY KEY PACKAGE.deb…
# KEY names a secret gpg key (in GNUPGHOME). A web server has to serve DIRECTORY/public, which includes the public key
# as fxagent.asc; conf and db next to it belong to reprepro. On each machine, as root:
#   install -m 644 fxagent.asc /etc/apt/keyrings/
#   echo "deb [signed-by=/etc/apt/keyrings/fxagent.asc] http://SERVER/ bookworm main" > /etc/apt/sources.list.d/fxagent.list
#   apt update && apt install fxagent
set -eu

[ $# -ge 3 ] || { echo "usage: $0 DIRECTORY KEY PACKAGE.deb…" >&2; exit 2; }
directory=$1 key=$2
shift 2
"$(dirname "$0")/install.sh" repository

# The first of several keys with that name; reprepro does not accept names with blanks.
fingerprint=$(gpg --batch --with-colons --list-secret-keys "$key" | awk -F: '/^fpr:/ { print $10; exit }')
mkdir -p "$directory/conf" "$directory/public"
cat >"$directory/conf/distributions" <<END
Origin: fxagent
Label: fxagent
Codename: bookworm
Architectures: amd64 arm64 armhf
Components: main
Description: fxagent for Debian 12
SignWith: $fingerprint
END
gpg --batch --yes --armor --output "$directory/public/fxagent.asc" --export "$key"
reprepro --basedir "$directory" --outdir +b/public --silent includedeb bookworm "$@"
