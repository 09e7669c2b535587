/* playbank BANK FILE: plays two notes and writes the left channel, doubles, for who compares it. */
#include <stdio.h>
#include "jawari.h"

enum { FRAMES = 20000 };
static double left[FRAMES], right[FRAMES];

int main(int n, char **given) {
    char why[JAWARI_WHY] = "";
    const jawari_event notes[] = {{0, JAWARI_NOTE_ON, 0, 48, 100, 0.0}, {99, JAWARI_NOTE_ON, 0, 43, 100, 0.0}};
    jawari_bank *bank = n == 3 ? jawari_open(given[1], why) : NULL;
    jawari_engine *engine = jawari_create(bank, 44100.0, 2, why);
    FILE *file = n == 3 ? fopen(given[2], "wb") : NULL;
    if (engine == NULL || file == NULL) {
        puts(why);
        return 1;
    }
    jawari_process(engine, notes, 2, FRAMES, left, right);
    const int written = fwrite(left, sizeof *left, FRAMES, file) == FRAMES;
    jawari_destroy(engine);
    jawari_close(bank);
    return fclose(file) == 0 && written ? 0 : 1;
}
