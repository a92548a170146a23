# Sourced by commands that need programs of others: says what is lacking. With KURS_REQUIRE_TOOLS=1, as in .ci/run, that is a failure.
lacking() {
    echo "skipped: $1"
    if [ "${KURS_REQUIRE_TOOLS:-0}" = 1 ]; then exit 1; fi
}
